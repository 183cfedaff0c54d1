#include "hostgen/fem/pushed_finger.h"

#include <algorithm>

#include "hostgen/fem/statics.h"

namespace finsight::host {

namespace {

ElasticState state_at_rest(const ElasticBody& body) {
  ElasticState rest(body);
  body.stresses(rest.u, rest.u, rest.stress);
  return rest;
}

}  // namespace

PushedFinger::PushedFinger(const FingerSpec& finger, const TetMesh& tets)
    : spec(finger),
      mesh(make_quadratic(tets)),
      body(mesh, tet_materials(finger, mesh.region)),
      rest(state_at_rest(body)) {}

std::vector<FacePoint> PushedFinger::spread_points(int count) const {
  std::vector<FacePoint> points;
  for (const Vec3f& point : touch_points(spec, count)) points.push_back(face_point(mesh, point.x(), point.y()));
  return points;
}

Eigen::Vector2d PushedFinger::inside(const Eigen::Vector2d& place_mm) const {
  const double y = std::clamp(place_mm.y(), spec.touch_y_mm[0], spec.touch_y_mm[1]);
  const double half = spec.half_width.at(y) - spec.touch_edge_mm;
  return {std::clamp(place_mm.x(), -half, half), y};
}

void PushedFinger::add_push(const FacePoint& at, double force_n, BodyVector& load) const {
  for (std::size_t i = 0; i < at.node.size(); ++i) {
    const int unknown = body.unknown_of_node()[static_cast<std::size_t>(at.node[i])];
    if (unknown == body.free_nodes()) continue;  // carried by the base at once
    Eigen::Map<Eigen::Vector3d>(&load[3 * static_cast<std::size_t>(unknown)]) += force_n * at.weight[i] * at.inward;
  }
}

bool PushedFinger::press(Equilibrium& solver, const BodyVector& load, ElasticState& answer) const {
  answer = rest;
  if (std::all_of(load.begin(), load.end(), [](double x) { return x == 0; })) return true;
  for (const int steps : {1, 3, 9}) {
    answer = rest;
    bool good = true;
    for (int k = 1; k <= steps && good; ++k) {
      BodyVector part = load;
      for (double& x : part) x *= static_cast<double>(k) / steps;
      good = solver.solve(part, answer);
    }
    if (good) return true;
  }
  return false;
}

Eigen::Vector3d PushedFinger::displacement(const ElasticState& state, int node) const {
  const auto unknown = static_cast<std::size_t>(body.unknown_of_node()[static_cast<std::size_t>(node)]);
  return Eigen::Map<const Eigen::Vector3d>(&state.u[3 * unknown]);
}

Eigen::Vector3d PushedFinger::displacement(const ElasticState& state, const FacePoint& at) const {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < at.node.size(); ++i) sum += at.weight[i] * displacement(state, at.node[i]);
  return sum;
}

PlatePoses PushedFinger::plates(const ElasticState& state) const {
  PlatePoses result;
  for (std::size_t i = 0; i < kPlates; ++i) {
    std::vector<Eigen::Vector3d> at_rest, now;
    for (const int node : mesh.plate_nodes[i]) {
      at_rest.push_back(mesh.node_mm[static_cast<std::size_t>(node)]);
      now.push_back(at_rest.back() + displacement(state, node));
    }
    result.plates[i] = rigid_fit(at_rest, now, spec.plates[i].T_finger_marker.translation());
    result.seen[i] = true;
  }
  result.quality = Quality::kFresh;
  return result;
}

std::vector<double> PushedFinger::node_displacement_mm(const ElasticState& state) const {
  std::vector<double> result;
  for (std::size_t node = 0; node < mesh.corner_nodes; ++node) {
    const Eigen::Vector3d u = displacement(state, static_cast<int>(node));
    result.insert(result.end(), u.begin(), u.end());
  }
  return result;
}

}  // namespace finsight::host
