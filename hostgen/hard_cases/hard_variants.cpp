// Hard cases other than plate motions: other meshes, units and solvers.
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "firmware/shape/soft_newton.h"
#include "hostgen/fem/shape_model.h"
#include "hostgen/hard_cases/hard_case.h"
#include "hostgen/hard_cases/shape_distance.h"

namespace finsight::host {

namespace {

using Points = Eigen::Matrix<double, 3, 4>;

// The smallest angle between two faces of a tetrahedron.
double smallest_dihedral_deg(const Points& x) {
  double smallest = 180;
  for (int a = 0; a < 4; ++a)
    for (int b = a + 1; b < 4; ++b) {  // the edge from a to b; the other two nodes span its faces
      const int c = a == 0 ? (b == 1 ? 2 : 1) : 0, d = 6 - a - b - c;
      const Eigen::Vector3d edge = (x.col(b) - x.col(a)).normalized();
      const auto across = [&](int node) -> Eigen::Vector3d {
        const Eigen::Vector3d side = x.col(node) - x.col(a);
        return (side - edge * edge.dot(side)).normalized();
      };
      const double cosine = std::clamp(across(c).dot(across(d)), -1.0, 1.0);
      smallest = std::min(smallest, std::acos(cosine) * 180 / std::numbers::pi);
    }
  return smallest;
}

Points points_of(const ShapeModel& shape, const std::vector<float>& node_mm, int tet) {
  Points x;
  for (int a = 0; a < 4; ++a)
    for (int d = 0; d < 3; ++d) x(d, a) = static_cast<double>(node_mm[3 * shape.tet_nodes[4 * tet + a] + d]);
  return x;
}

double volume(const Points& x) { return (x.col(1) - x.col(0)).cross(x.col(2) - x.col(0)).dot(x.col(3) - x.col(0)); }

// Rest positions with some slivers: in tetrahedra all over the mesh a free node is moved towards the opposite face
// until the smallest dihedral angle has the wanted value, unless that would invert or flatten a neighbour.
std::vector<float> with_slivers(const ShapeModel& shape, double dihedral_deg, int& slivers) {
  std::vector<float> node_mm(shape.rest_mm.begin(), shape.rest_mm.end());
  std::vector<std::vector<int>> tets_of(static_cast<std::size_t>(shape.nodes));
  for (int i = 0; i < 4 * shape.tets; ++i) tets_of[static_cast<std::size_t>(shape.tet_nodes[i])].push_back(i / 4);
  std::vector<char> touched(static_cast<std::size_t>(shape.tets), 0);
  for (int t = 0; t < shape.tets; t += 5) {
    for (int a = 0; a < 4; ++a) {
      const int node = shape.tet_nodes[4 * t + a];
      const auto& around = tets_of[static_cast<std::size_t>(node)];
      if (shape.free_index[node] < 0 || std::any_of(around.begin(), around.end(), [&](int u) { return touched[u]; }))
        continue;
      const Points x = points_of(shape, node_mm, t);
      const Eigen::Vector3d face = (x.col((a + 1) % 4) + x.col((a + 2) % 4) + x.col((a + 3) % 4)) / 3;
      double low = 0, high = 1;  // fraction of the path to the face's centroid
      for (int k = 0; k < 40; ++k) {
        const double part = (low + high) / 2;
        Points moved = x;
        moved.col(a) += part * (face - x.col(a));
        (smallest_dihedral_deg(moved) > dihedral_deg ? low : high) = part;
      }
      std::vector<float> trial = node_mm;
      for (int d = 0; d < 3; ++d) trial[3 * node + d] = static_cast<float>(x(d, a) + low * (face[d] - x(d, a)));
      const bool usable = std::all_of(around.begin(), around.end(), [&](int u) {
        const Points y = points_of(shape, trial, u);
        return volume(y) > 0 && (u == t || smallest_dihedral_deg(y) > dihedral_deg);
      });
      if (!usable) continue;
      node_mm = trial;
      for (const int u : around) touched[static_cast<std::size_t>(u)] = 1;
      ++slivers;
      break;
    }
  }
  return node_mm;
}

void run_slivers(const ShapeParts& parts, std::vector<HardCaseResult>& results) {
  for (const double dihedral_deg : {5.0, 1.0, 0.5}) {
    int slivers = 0;
    const std::vector<float> rest = with_slivers(parts.shape, dihedral_deg, slivers);
    ShapeParts thin = parts;
    thin.shape.rest_mm = rest;
    char text[96];
    std::snprintf(text, sizeof text, "%d slivers with dihedral angles of %.1f deg, ", slivers, dihedral_deg);
    const std::string name = text;
    results.push_back(run_hard_case(
        thin, {name + "bend and twist", HardMotion(parts.mount).bend({30, 0, 45}).bend({}).hold(10), 0.5}));
    results.push_back(run_hard_case(
        thin,
        {name + "jumps", HardMotion(parts.mount).go(Bend{30, 0, 45}, 1).hold(5).go(Bend{}, 1).hold(10), kNoLimit}));
  }
}

void run_units(const ShapeParts& parts, std::vector<HardCaseResult>& results) {
  for (const auto& [name, unit_mm] : {std::pair{"finger in metres", 1e-3}, std::pair{"finger in micrometres", 1e3}}) {
    const auto factor = static_cast<float>(unit_mm);
    std::vector<float> rest(parts.shape.rest_mm.begin(), parts.shape.rest_mm.end());
    std::vector<float> basis(parts.map.basis.begin(), parts.map.basis.end());
    std::vector<float> scale(parts.map.scale.begin(), parts.map.scale.end());
    for (float& value : rest) value *= factor;
    for (float& value : basis) value *= factor;
    for (std::size_t i = 0; i < scale.size(); ++i)
      if (i % 6 < 3) scale[i] /= factor;
    ShapeParts scaled = parts;
    scaled.shape.rest_mm = rest;
    scaled.map.basis = basis;
    scaled.map.scale = scale;
    for (auto& T_finger_marker : scaled.mount.T_finger_marker) T_finger_marker.translation() *= factor;
    results.push_back(run_hard_case(
        scaled,
        {.name = name, .motion = HardMotion(parts.mount).bend({30, 0, 45}).bend({}).hold(10), .unit_mm = unit_mm}));
  }
}

void run_tiers(const ShapeParts& parts, std::vector<HardCaseResult>& results) {
  using Tier = ShapeSettings::Tier;
  const HardMotion motion =
      HardMotion(parts.mount).bend({30, 0, 45}).go(Bend{-30, 0, -45}, 1).hold(3).go(Bend{}, 1).hold(10);
  const std::pair<const char*, ShapeSettings> tiers[] = {
      {"tier map, far out of its range", {Tier::kMap, 1, 0}},
      {"tier map+newton, far out of the map's range", {Tier::kMapAndNewton, 1, 1}},
      {"five factorisations", {Tier::kNewton, 5, 2}},
      {"one factorisation, no chord step", {Tier::kNewton, 1, 0}}};
  for (const auto& [name, settings] : tiers)
    results.push_back(run_hard_case(
        parts, {.name = name, .motion = motion, .allowed_mm = kNoLimit, .allowed_end_mm = 0.05, .settings = settings}));
}

// The shape of a bent finger with one node pushed through the opposite face of a tetrahedron.
void run_inverted_start(const ShapeParts& parts, std::vector<HardCaseResult>& results) {
  HardCaseResult result{.name = "an inverted start"};
  result.allowed_steps = max_steps({});
  result.allowed_mm = result.allowed_end_mm = 0.05;
  const PlatePoses poses = HardMotion(parts.mount).poses({10, 0, 15});
  NewtonSolver<float> solver(parts.shape, parts.mount);
  std::vector<float> shape(parts.shape.rest_mm.begin(), parts.shape.rest_mm.end());
  int t = 0;
  while (parts.shape.free_index[parts.shape.tet_nodes[4 * t]] < 0) ++t;
  const Points x = points_of(parts.shape, shape, t);
  const Eigen::Vector3d mirrored = x.col(0) + 2 * ((x.col(1) + x.col(2) + x.col(3)) / 3 - x.col(0));
  for (int d = 0; d < 3; ++d) shape[3 * parts.shape.tet_nodes[4 * t] + d] = static_cast<float>(mirrored[d]);
  result.inverted_unflagged += solver.start_from(shape, plate_motions(poses));
  solver.start_towards(shape, plate_motions(poses));
  for (int frame = 0; frame < 10; ++frame) {
    const auto outcome = solver.solve(poses, 1, 1);
    FingerShape answer{.node_mm = solver.node_mm(), .iterations = outcome.steps, .fallback = !outcome.ok};
    answer.quality = Quality::kFresh;
    examine(parts, answer, result);
  }
  result.worst_mm = result.end_mm = HardCaseTruth(parts, 1).distance(poses, solver.node_mm()).value_or(kNoLimit);
  results.push_back(result);
}

void run_float_against_double(const ShapeParts& parts, std::vector<HardCaseResult>& results) {
  HardCaseResult result{.name = "float against double"};
  result.allowed_steps = max_steps({});
  result.allowed_mm = result.allowed_end_mm = 1e-3;
  NewtonSolver<float> single(parts.shape, parts.mount);
  NewtonSolver<double> reference(parts.shape, parts.mount);
  const HardMotion motion = HardMotion(parts.mount).bend({30, 0, 45}).bend({-30, 10, -45}).bend({}).hold(5);
  for (const PlatePoses& poses : motion.frames) {
    const auto outcome = single.solve(poses, 1, 1);
    FingerShape answer{.node_mm = single.node_mm(), .iterations = outcome.steps, .fallback = !outcome.ok};
    answer.quality = Quality::kFresh;
    examine(parts, answer, result);
    result.flagged += !reference.solve(poses, 1, 1).ok;
    result.end_mm = shape_distance(single.node_mm(), reference.node_mm()).worst_mm;
    result.worst_mm = std::max(result.worst_mm, result.end_mm);
  }
  results.push_back(result);
}

// Soft handles: the stiffer the springs, the closer the shape to that with the plates moved exactly.
void run_soft_handles(const ShapeParts& parts, std::vector<HardCaseResult>& results) {
  const ShapeModelData soft_model = make_soft_shape_model(parts.shape);
  const HardMotion motion = HardMotion(parts.mount).bend({30, 0, 45}, 4).hold(2);
  for (const double omega : {1.0, 1e2, 1e5, 1e7, 1e9}) {
    char name[64];
    std::snprintf(name, sizeof name, "soft handles, omega %.0e", omega);
    HardCaseResult result{.name = name};
    result.allowed_steps = SoftNewtonSolver<double>::kPublishedSteps;
    result.allowed_mm = kNoLimit;
    result.allowed_end_mm = omega >= 1e5 ? 0.05 : kNoLimit;
    SoftNewtonSolver<double> solver(soft_model.view(), parts.mount, omega);
    std::vector<float> node_mm(parts.shape.rest_mm.size());
    for (const PlatePoses& poses : motion.frames) {
      const auto outcome = solver.converge(poses);
      std::transform(solver.node_mm().begin(), solver.node_mm().end(), node_mm.begin(),
                     [](double value) { return static_cast<float>(value); });
      FingerShape answer{.node_mm = node_mm, .iterations = outcome.steps, .fallback = !outcome.ok};
      answer.quality = Quality::kFresh;
      examine(parts, answer, result);
    }
    NewtonSolver<double> exact(parts.shape, parts.mount);
    exact.converge(motion.frames.back(), 1e-6, 300);
    result.worst_mm = result.end_mm = shape_distance(std::span<const float>(node_mm), exact.node_mm()).worst_mm;
    results.push_back(result);
  }
}

}  // namespace

std::span<const HardVariant> hard_variants() {
  static constexpr HardVariant kVariants[] = {{"slivers", run_slivers},
                                              {"other units", run_units},
                                              {"other tiers and schedules", run_tiers},
                                              {"inverted start", run_inverted_start},
                                              {"float against double", run_float_against_double},
                                              {"soft handles", run_soft_handles}};
  return kVariants;
}

}  // namespace finsight::host
