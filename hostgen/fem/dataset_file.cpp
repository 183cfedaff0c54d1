// Training sets as safetensors files, whole and in shards.
#include "hostgen/fem/dataset_file.h"

#include <algorithm>
#include <map>

#include "firmware/input_error.h"
#include "hostgen/pack/tensor_file.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

constexpr std::size_t kDatasetLimit_bytes = std::size_t{16} << 30;
// Force, point, contact, force vector, moment, spread, plates.
constexpr std::size_t kPlateNumbers = 1 + 3 + 3 + 3 + 3 + 1;  // where those of the plates begin
constexpr std::size_t kStateNumbers = kPlateNumbers + kPoseDims;
constexpr const char* kFormat = "8";

constexpr std::int32_t kMaxScene = 9, kMaxKind = 99;

int count_in(const SafetensorsFile& in, const std::string& key) {
  const std::string& text = in.metadata(key);
  const int count = text.size() < 8 && text.find_first_not_of("0123456789") == text.npos ? std::atoi(text.c_str()) : 0;
  if (count < 1) throw InputError(in.path(), key, "'" + text + "'", "a number of 1 or more");
  return count;
}

// Paths come in order, each whole, none left out. `paths`: how many there should be.
void check_all_paths(const FemDataset& dataset, std::size_t paths, const std::string& name) {
  const std::vector<FemState> states = all_states(dataset);
  const auto forces = static_cast<std::size_t>(dataset.plan.forces);
  for (std::size_t i = 0; i < paths * forces; ++i) {
    const int path = static_cast<int>(i / forces);
    if (i >= states.size() || states[i].path != path) {
      throw InputError(name, "path " + std::to_string(path) + " of " + std::to_string(paths) + " is missing");
    }
  }
}

void append_numbers(const FemState& state, std::vector<float>& numbers) {
  const auto append = [&](const Vec3f& v) { numbers.insert(numbers.end(), v.data(), v.data() + 3); };
  numbers.push_back(state.force_n);
  append(state.point_mm);
  append(state.contact_mm);
  append(state.force_vector_n);
  append(state.moment_nmm);
  numbers.push_back(state.spread_mm);
  for (const PlateMotion& plate : state.plates) {
    append(plate.displacement_mm);
    append(plate.rotation_rad);
  }
}

FemState state_of(const float* row) {
  FemState state;
  state.force_n = row[0];
  state.point_mm = Eigen::Map<const Vec3f>(row + 1);
  state.contact_mm = Eigen::Map<const Vec3f>(row + 4);
  state.force_vector_n = Eigen::Map<const Vec3f>(row + 7);
  state.moment_nmm = Eigen::Map<const Vec3f>(row + 10);
  state.spread_mm = row[13];
  for (std::size_t p = 0; p < kPlates; ++p) {
    state.plates[p] = {Eigen::Map<const Vec3f>(row + kPlateNumbers + 6 * p),
                       Eigen::Map<const Vec3f>(row + kPlateNumbers + 3 + 6 * p)};
  }
  return state;
}

}  // namespace

std::vector<FemState> all_states(const FemDataset& dataset) {
  std::vector<FemState> all = dataset.states;
  all.insert(all.end(), dataset.others.begin(), dataset.others.end());
  all.insert(all.end(), dataset.kept.begin(), dataset.kept.end());
  return all;
}

void write_dataset(const std::filesystem::path& file, const FemDataset& dataset) {
  const std::vector<FemState> states = all_states(dataset);
  const auto count = static_cast<std::int64_t>(states.size());
  std::vector<float> numbers, nearby;
  std::vector<std::int32_t> labels;
  std::vector<std::uint8_t> valid, outcome, nearby_count;
  for (const FemState& state : states) {
    append_numbers(state, numbers);
    for (const FemState& other : state.nearby) append_numbers(other, nearby);
    nearby_count.push_back(static_cast<std::uint8_t>(state.nearby.size()));
    labels.insert(labels.end(), {state.path, state.front_node, state.scene});
    valid.push_back(state.valid());
    outcome.push_back(static_cast<std::uint8_t>(state.outcome));
  }
  TensorFile out;
  out.metadata = {
      {"finsight_dataset", kFormat},
      {"spec_sha256", dataset.spec_sha256},
      {"mesh_sha256", dataset.mesh_sha256},
      {"points", std::to_string(dataset.plan.points)},
      {"forces", std::to_string(dataset.plan.forces)},
      {"outcomes",
       "0 equilibrium, 1 pushed too far, 2 no equilibrium (snap-through, buckling), 3 not converged (numerical)"},
      {"scene", dataset.plan.scene},
      {"columns",
       "force_n, point_mm xyz, contact_mm xyz, force_vector_n xyz, moment_nmm xyz, spread_mm, top/middle/low "
       "displacement_mm xyz rotation_rad xyz"}};
  out.add("states", {count, kStateNumbers}, numbers);
  out.add("path_node_scene", {count, 3}, labels);
  out.add("valid", {count}, valid);
  out.add("outcome", {count}, outcome);
  out.add("nearby_count", {count}, nearby_count);
  out.add("nearby", {static_cast<std::int64_t>(nearby.size() / kStateNumbers), kStateNumbers}, nearby);
  out.add("node_displacement_mm",
          {static_cast<std::int64_t>(dataset.states.size()), static_cast<std::int64_t>(dataset.mesh_nodes), 3},
          dataset.node_displacement_mm);
  out.write(file);
}

FemDataset read_dataset(const std::filesystem::path& file) {
  const SafetensorsFile in = SafetensorsFile::open(file, kDatasetLimit_bytes);
  if (in.metadata("finsight_dataset") != kFormat) {
    throw InputError(file.string(), "finsight_dataset", in.metadata("finsight_dataset"), kFormat);
  }
  const auto numbers = in.tensor<float>("states", {-1, kStateNumbers});
  const auto count = static_cast<std::int64_t>(numbers.size() / kStateNumbers);
  const auto labels = in.tensor<std::int32_t>("path_node_scene", {count, 3});
  const auto outcome = in.tensor<std::uint8_t>("outcome", {count});
  const auto nearby_count = in.tensor<std::uint8_t>("nearby_count", {count});
  const auto nearby = in.tensor<float>("nearby", {-1, kStateNumbers});
  const auto displacement = in.tensor<float>("node_displacement_mm", {-1, -1, 3});

  FemDataset dataset{.spec_sha256 = in.metadata("spec_sha256"),
                     .states = {},
                     .others = {},
                     .kept = {},
                     .node_displacement_mm = {displacement.begin(), displacement.end()},
                     .mesh_nodes = static_cast<std::size_t>(in.shape("node_displacement_mm")[1]),
                     .plan = {count_in(in, "points"), count_in(in, "forces"), in.metadata("scene")},
                     .mesh_sha256 = in.metadata("mesh_sha256")};
  std::size_t next_nearby = 0;
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
    if (outcome[i] > 3) in.refuse("outcome", std::to_string(outcome[i]), "0, 1, 2 or 3");
    const std::int32_t* label = &labels[3 * i];
    if (label[2] < 0 || (label[2] > kMaxScene && (label[2] < kFirstKept || label[2] > kFirstKept + kMaxKind))) {
      in.refuse("path_node_scene", std::to_string(label[2]),
                "a scene from 0 to " + std::to_string(kMaxScene) + " or a kind from " + std::to_string(kFirstKept));
    }
    if (label[0] < 0 || (label[0] < dataset.plan.points) != (label[2] == 0)) {
      in.refuse("path_node_scene", "path " + std::to_string(label[0]) + " of scene " + std::to_string(label[2]),
                "paths of the scene first, then those of others");
    }
    if (label[1] < 0 || static_cast<std::size_t>(label[1]) >= dataset.mesh_nodes) {
      in.refuse("path_node_scene", std::to_string(label[1]), "a node of the mesh");
    }
    FemState state = state_of(&numbers[kStateNumbers * i]);
    state.path = label[0];
    state.front_node = label[1];
    state.scene = static_cast<std::uint8_t>(label[2]);
    state.step = static_cast<std::int32_t>(i % static_cast<std::size_t>(dataset.plan.forces));
    state.outcome = static_cast<Outcome>(outcome[i]);
    if (kStateNumbers * (next_nearby + nearby_count[i]) > nearby.size()) {
      in.refuse("nearby_count", std::to_string(nearby_count[i]), "no more than are there");
    }
    for (int k = 0; k < nearby_count[i]; ++k) state.nearby.push_back(state_of(&nearby[kStateNumbers * next_nearby++]));
    states_of_scene(dataset, state.scene).push_back(state);
    const std::size_t first = i - i % static_cast<std::size_t>(dataset.plan.forces);
    if (state.path != labels[3 * first]) {
      in.refuse("path_node_scene", std::to_string(state.path), "all forces of a path together");
    }
  }
  if (kStateNumbers * next_nearby != nearby.size()) {
    in.refuse("nearby", std::to_string(nearby.size() / kStateNumbers) + " states", std::to_string(next_nearby));
  }
  if (static_cast<std::size_t>(count) % static_cast<std::size_t>(dataset.plan.forces) != 0) {
    in.refuse("states", std::to_string(count), "a multiple of the number of forces");
  }
  if (displacement.size() != 3 * dataset.mesh_nodes * dataset.states.size()) {
    in.refuse("node_displacement_mm", std::to_string(displacement.size()) + " numbers", "those of every state");
  }
  return dataset;
}

std::vector<FemState>& states_of_scene(FemDataset& dataset, std::uint8_t scene) {
  if (scene >= kFirstKept) return dataset.kept;
  return scene == 0 ? dataset.states : dataset.others;
}

void append(const FemDataset& part, FemDataset& whole) {
  whole.states.insert(whole.states.end(), part.states.begin(), part.states.end());
  whole.others.insert(whole.others.end(), part.others.begin(), part.others.end());
  whole.kept.insert(whole.kept.end(), part.kept.begin(), part.kept.end());
  whole.node_displacement_mm.insert(whole.node_displacement_mm.end(), part.node_displacement_mm.begin(),
                                    part.node_displacement_mm.end());
}

void check_same_plan(const FemDataset& expected, const FemDataset& found, const std::filesystem::path& file) {
  const auto check = [&](const char* field, const std::string& is, const std::string& should) {
    if (is != should) throw InputError(file.string(), field, is, should + " as in the rest of the set");
  };
  check("spec_sha256", found.spec_sha256, expected.spec_sha256);
  check("mesh_sha256", found.mesh_sha256, expected.mesh_sha256);
  check("scene", found.plan.scene, expected.plan.scene);
  check("points", std::to_string(found.plan.points), std::to_string(expected.plan.points));
  check("forces", std::to_string(found.plan.forces), std::to_string(expected.plan.forces));
}

FemDataset merge_datasets(const std::vector<std::filesystem::path>& files) {
  std::vector<FemDataset> shards;
  for (const auto& file : files) {
    shards.push_back(read_dataset(file));
    check_same_plan(shards.front(), shards.back(), file);
  }
  // Where the states of each path begin: in which shard, at which of its states.
  struct Place {
    std::size_t shard, state;
    std::uint8_t scene;
  };
  std::map<std::int32_t, Place> places;
  for (std::size_t s = 0; s < shards.size(); ++s) {
    const auto forces = static_cast<std::size_t>(shards[s].plan.forces);
    for (const auto* states : {&shards[s].states, &shards[s].others, &shards[s].kept}) {
      for (std::size_t i = 0; i < states->size(); i += forces) {
        const auto [place, is_new] = places.try_emplace((*states)[i].path, Place{s, i, (*states)[i].scene});
        if (is_new) continue;
        throw InputError(files[s].string(), "path " + std::to_string(place->first) + " is in " +
                                                files[place->second.shard].string() + " as well");
      }
    }
  }
  FemDataset whole = shards.front();
  whole.states.clear();
  whole.others.clear();
  whole.kept.clear();
  whole.node_displacement_mm.clear();
  const auto count = static_cast<std::ptrdiff_t>(whole.plan.forces);
  const auto size = static_cast<std::ptrdiff_t>(3 * whole.mesh_nodes);
  for (const auto& [path, place] : places) {
    FemDataset& shard = shards[place.shard];
    const auto from = static_cast<std::ptrdiff_t>(place.state);
    const std::vector<FemState>& states = states_of_scene(shard, place.scene);
    std::vector<FemState>& all = states_of_scene(whole, place.scene);
    all.insert(all.end(), states.begin() + from, states.begin() + from + count);
    if (place.scene != 0) continue;
    whole.node_displacement_mm.insert(whole.node_displacement_mm.end(),
                                      shard.node_displacement_mm.begin() + from * size,
                                      shard.node_displacement_mm.begin() + (from + count) * size);
  }
  const std::string name = files.size() == 1 ? files.front().string() : std::to_string(files.size()) + " shards";
  check_all_paths(whole, path_count(whole.plan), name);
  return whole;
}

void check_complete(const FemDataset& dataset, const FingerSpec& spec, const TetMesh& mesh,
                    const std::filesystem::path& file) {
  FemDataset expected;
  expected.spec_sha256 = spec.sha256;
  expected.mesh_sha256 = mesh_sha256(mesh);
  expected.plan = dataset.plan;
  check_same_plan(expected, dataset, file);
  check_all_paths(dataset, path_count(dataset.plan), file.string());
}

std::string mesh_sha256(const TetMesh& mesh) {
  const auto bytes = [](const auto& values) {
    return std::string(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(values[0]));
  };
  return sha256_hex(bytes(mesh.node_mm) + bytes(mesh.tets) + bytes(mesh.region));
}

}  // namespace finsight::host
