#include "hostgen/fem/pushed_finger.h"

#include <Eigen/SVD>
#include <algorithm>

#include "firmware/geometry/so3.h"
#include "hostgen/fem/dataset.h"
#include "hostgen/util/gravity.h"

namespace finsight::host {

namespace {

Eigen::Vector3d mean(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& point : points) sum += point / static_cast<double>(points.size());
  return sum;
}

double tet_mass_kg(const PushedFinger& finger, const std::array<int, kTetNodes>& tet) {
  constexpr double kM3PerMm3 = 1e-9;
  std::array<Eigen::Vector3d, 4> corner;
  for (std::size_t i = 0; i < 4; ++i) corner[i] = finger.mesh.node_mm[static_cast<std::size_t>(tet[i])];
  return finger.spec.density_kg_m3 * kM3PerMm3 * tet_gradients(corner, finger.mesh.element).volume_mm3;
}

}  // namespace

Eigen::Matrix3d rigid_rotation(const std::vector<Eigen::Vector3d>& rest, const std::vector<Eigen::Vector3d>& now) {
  const Eigen::Vector3d rest_mean = mean(rest), now_mean = mean(now);
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < rest.size(); ++i) {
    covariance += (now[i] - now_mean) * (rest[i] - rest_mean).transpose();
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Vector3d signs(1, 1, (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0 ? -1 : 1);
  return svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
}

std::vector<NeoHookean> tet_materials(const FingerSpec& spec, const std::vector<int>& region) {
  std::vector<NeoHookean> material;
  for (const int label : region) {
    const double stiffness = label >= kFirstPlateRegion ? spec.plate_stiffness_ratio : 1;
    material.push_back(neo_hookean(stiffness * spec.youngs_modulus_mpa, spec.poisson_ratio));
  }
  return material;
}

PushedFinger::PushedFinger(const FingerSpec& finger, const TetMesh& tets, Element element, const CheckIn& check_in)
    : spec(finger),
      mesh(make_quadratic(tets, element)),
      body(mesh, tet_materials(finger, mesh.region), check_in),
      rest(body) {}

std::vector<FacePoint> PushedFinger::spread_points(int count) const {
  std::vector<FacePoint> points;
  for (const Vec3f& point : touch_points(spec, count)) points.push_back(at(point.head<2>().cast<double>()));
  return points;
}

Eigen::Vector2d PushedFinger::inside(const Eigen::Vector2d& place_mm) const {
  const double y = std::clamp(place_mm.y(), spec.touch_y_mm[0], spec.touch_y_mm[1]);
  const double half = spec.half_width.at(y) - spec.touch_edge_mm;
  return {std::clamp(place_mm.x(), -half, half), y};
}

void PushedFinger::add_force(const FacePoint& at, const Eigen::Vector3d& force_n, BodyVector& load) const {
  for (std::size_t i = 0; i < at.node.size(); ++i) {
    const int unknown = body.unknown_of_node()[static_cast<std::size_t>(at.node[i])];
    if (unknown == body.free_nodes()) continue;  // carried by the base at once
    Eigen::Map<Eigen::Vector3d>(&load[3 * static_cast<std::size_t>(unknown)]) += at.weight[i] * force_n;
  }
}

void PushedFinger::add_weight(const Eigen::Vector3d& g, BodyVector& load) const {
  // Of a tet's ten nodes in the integral of a constant over it: exact for quadratic tets.
  constexpr double kCornerWeight = -0.05, kMiddleWeight = 0.2;
  for (const auto& tet : mesh.tets) {
    const double weight_n = kGravity_m_s2 * tet_mass_kg(*this, tet);
    for (std::size_t i = 0; i < kTetNodes; ++i) {
      const int unknown = body.unknown_of_node()[static_cast<std::size_t>(tet[i])];
      if (unknown == body.free_nodes()) continue;
      Eigen::Map<Eigen::Vector3d>(&load[3 * static_cast<std::size_t>(unknown)]) +=
          (i < 4 ? kCornerWeight : kMiddleWeight) * weight_n * g;
    }
  }
}

double PushedFinger::mass_kg() const {
  double sum_kg = 0;
  for (const auto& tet : mesh.tets) sum_kg += tet_mass_kg(*this, tet);
  return sum_kg;
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
    const Eigen::Vector3d centre = spec.plates[i].T_finger_marker.translation();
    const Eigen::Matrix3d R = rigid_rotation(at_rest, now);
    result.plates[i] = {(mean(now) + R * (centre - mean(at_rest)) - centre).cast<float>(), so3_log(R).cast<float>()};
    result.seen[i] = true;
  }
  result.quality = Quality::kFresh;
  return result;
}

std::vector<double> PushedFinger::quadratic_displacement_mm(const ElasticState& state) const {
  std::vector<double> result;
  for (std::size_t node = 0; node < mesh.node_mm.size(); ++node) {
    const Eigen::Vector3d u = displacement(state, static_cast<int>(node));
    result.insert(result.end(), u.begin(), u.end());
  }
  return result;
}

std::vector<double> PushedFinger::node_displacement_mm(const ElasticState& state) const {
  std::vector<double> result = quadratic_displacement_mm(state);
  result.resize(3 * mesh.corner_nodes);
  return result;
}

}  // namespace finsight::host
