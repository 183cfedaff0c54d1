#include "hostgen/fem/dataset.h"

#include <algorithm>
#include <limits>

#include "firmware/input_error.h"
#include "hostgen/common.h"
#include "hostgen/fem/statics.h"
#include "hostgen/pack/tensor_file.h"

namespace finsight::host {

namespace {

/// The states of one contact point, from the lowest force up.
struct Path {
  std::vector<FemState> states;
  std::vector<float> displacement_mm;
};

std::int32_t nearest_front_node(const TetMesh& mesh, const Vec3f& point_mm) {
  std::int32_t nearest = -1;
  double nearest_sq = std::numeric_limits<double>::max();
  for (const int node : mesh.front_nodes) {
    const auto& at = mesh.node_mm[static_cast<std::size_t>(node)];
    const double distance_sq =
        (Eigen::Map<const Eigen::Vector3d>(at.data()) - point_mm.cast<double>()).squaredNorm();
    if (distance_sq < nearest_sq) {
      nearest_sq = distance_sq;
      nearest = node;
    }
  }
  return nearest;
}

// A force that finds no equilibrium or pushes too far keeps its place in the set, marked as not valid, with the last state
// that was found; so do the higher forces of its path, which are not tried.
Path walk_path(FingerStatics& statics, const TetMesh& mesh, const Vec3f& point_mm, std::int32_t index,
               const std::vector<double>& forces_n) {
  statics.reset();
  Path path;
  bool reached = true;
  for (const double force_n : forces_n) {
    reached = reached && statics.load(point_mm, force_n);
    FemState state = statics.state();
    state.path = index;
    state.front_node = nearest_front_node(mesh, point_mm);
    state.point_mm = point_mm;
    state.force_n = static_cast<float>(force_n);
    reached = reached && state.valid;
    state.valid = reached;
    path.states.push_back(state);
    const std::vector<double> displacement = statics.node_displacement_mm();
    path.displacement_mm.insert(path.displacement_mm.end(), displacement.begin(), displacement.end());
  }
  return path;
}

constexpr std::size_t kDatasetLimit_bytes = std::size_t{512} << 20;
constexpr std::size_t kStateNumbers = 1 + 3 + 3 + 6 * kPlates;  // force, point, contact, plates

}  // namespace

FemDataset make_dataset(const FingerSpec& spec, const TetMesh& mesh, const DatasetPlan& plan) {
  const std::vector<Vec3f> points = touch_points(spec, plan.points);
  std::vector<double> forces_n;
  for (int k = 0; k < plan.forces; ++k) {
    forces_n.push_back(spec.force_n[0] + (spec.force_n[1] - spec.force_n[0]) * k / std::max(1, plan.forces - 1));
  }
  const auto setup = make_statics_setup(spec, mesh);
  std::vector<Path> paths(points.size());
  {
    Progress progress("finite-element load paths", points.size());
    parallel_for(points.size(), [&](std::size_t i) {
      // One solver per thread, started afresh for each path.
      thread_local std::shared_ptr<const StaticsSetup> owner;
      thread_local std::unique_ptr<FingerStatics> statics;
      if (owner != setup) {
        statics = std::make_unique<FingerStatics>(setup);
        owner = setup;
      }
      paths[i] = walk_path(*statics, mesh, points[i], static_cast<std::int32_t>(i), forces_n);
      progress.advance();
    });
  }
  FemDataset dataset{.spec_sha256 = spec.sha256, .states = {}, .node_displacement_mm = {}, .mesh_nodes = mesh.node_mm.size()};
  for (const Path& path : paths) {
    dataset.states.insert(dataset.states.end(), path.states.begin(), path.states.end());
    dataset.node_displacement_mm.insert(dataset.node_displacement_mm.end(), path.displacement_mm.begin(),
                                        path.displacement_mm.end());
  }
  return dataset;
}

void write_dataset(const std::filesystem::path& file, const FemDataset& dataset) {
  const auto count = static_cast<std::int64_t>(dataset.states.size());
  std::vector<float> numbers;
  std::vector<std::int32_t> labels;
  std::vector<std::uint8_t> valid;
  const auto append = [&](const Vec3f& v) { numbers.insert(numbers.end(), v.data(), v.data() + 3); };
  for (const FemState& state : dataset.states) {
    numbers.push_back(state.force_n);
    append(state.point_mm);
    append(state.contact_mm);
    for (const PlateMotion& plate : state.plates) {
      append(plate.displacement_mm);
      append(plate.rotation_rad);
    }
    labels.insert(labels.end(), {state.path, state.front_node});
    valid.push_back(state.valid);
  }
  TensorFile out;
  out.metadata = {{"finsight_dataset", "1"},
                  {"spec_sha256", dataset.spec_sha256},
                  {"columns", "force_n, point_mm xyz, contact_mm xyz, top/middle/low displacement_mm xyz rotation_rad xyz"}};
  out.add("states", {count, kStateNumbers}, numbers);
  out.add("path_and_front_node", {count, 2}, labels);
  out.add("valid", {count}, valid);
  out.add("node_displacement_mm", {count, static_cast<std::int64_t>(dataset.mesh_nodes), 3}, dataset.node_displacement_mm);
  out.write(file);
}

FemDataset read_dataset(const std::filesystem::path& file) {
  const SafetensorsFile in = SafetensorsFile::open(file, kDatasetLimit_bytes);
  if (in.metadata("finsight_dataset") != "1") {
    throw InputError(file.string(), "finsight_dataset", in.metadata("finsight_dataset"), "1");
  }
  const auto numbers = in.tensor<float>("states", {-1, kStateNumbers});
  const auto count = static_cast<std::int64_t>(numbers.size() / kStateNumbers);
  const auto labels = in.tensor<std::int32_t>("path_and_front_node", {count, 2});
  const auto valid = in.tensor<std::uint8_t>("valid", {count});
  const auto displacement = in.tensor<float>("node_displacement_mm", {count, -1, 3});

  FemDataset dataset{.spec_sha256 = in.metadata("spec_sha256"),
                     .states = {},
                     .node_displacement_mm = {displacement.begin(), displacement.end()},
                     .mesh_nodes = static_cast<std::size_t>(in.shape("node_displacement_mm")[1])};
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
    const float* row = &numbers[kStateNumbers * i];
    FemState state{.path = labels[2 * i],
                   .front_node = labels[2 * i + 1],
                   .force_n = row[0],
                   .point_mm = Eigen::Map<const Vec3f>(row + 1),
                   .contact_mm = Eigen::Map<const Vec3f>(row + 4),
                   .plates = {},
                   .valid = valid[i] != 0};
    for (std::size_t p = 0; p < kPlates; ++p) {
      state.plates[p] = {Eigen::Map<const Vec3f>(row + 7 + 6 * p), Eigen::Map<const Vec3f>(row + 10 + 6 * p)};
    }
    dataset.states.push_back(state);
  }
  return dataset;
}

}  // namespace finsight::host
