#include "hostgen/fem/gravity_response.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <vector>

#include "hostgen/fem/scene_contacts.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

constexpr double kStrongest_g = 3;
constexpr int kForces = 3;

struct BentFinger {
  PoseVectorOf<double> bent;
  MotionPerG per_g;
};

/// A finger that bends under its weight and under a touch of the scene, by several forces.
std::vector<BentFinger> bend(FingerStatics& statics, const FingerSpec& spec, const Scene& scene, const Vec3f& point_mm,
                             Random& random) {
  std::vector<BentFinger> found;
  const std::vector<FaceContact> contacts = draw_contacts(spec, scene, point_mm.head<2>().cast<double>(), random);
  const Eigen::Vector3d felt_g = random.uniform(0, kStrongest_g) * random_direction(random);
  std::array<double, kForces> forces_n;
  for (double& force_n : forces_n) force_n = random.uniform(0, spec.force_n[1]);
  std::ranges::sort(forces_n);
  if (!statics.begin(contacts, felt_g)) return found;
  for (const double force_n : forces_n) {
    if (!statics.press(force_n) || !statics.state().valid()) break;
    const std::optional<MotionPerG> per_g = statics.motion_per_g();
    if (!per_g) break;
    found.push_back({pose_vector(PlatePoses{.plates = statics.state().plates}).cast<double>(), *per_g});
  }
  return found;
}

/// Least squares for plate numbers that are measured with the spec's noise. Of fingers that answer quite otherwise than
/// at rest the relative error counts: those about to snap through would decide alone.
void fit_change(const std::vector<BentFinger>& fingers, const PoseVectorOf<double>& noise, GravityResponse& response) {
  constexpr double kUsual_mm = 10;
  constexpr double kLargeChange = 20;  // per g, in units of the noise
  using Features = Eigen::Matrix<double, kBentFeatures, 1>;
  Features deviation;
  deviation << noise, kUsual_mm * noise;
  Eigen::Matrix<double, kBentFeatures, kBentFeatures> normal = deviation.cwiseAbs2().asDiagonal();
  normal *= static_cast<double>(fingers.size());
  Eigen::Matrix<double, kBentFeatures, 3 * kPoseDims> right;
  right.setZero();
  for (const BentFinger& finger : fingers) {
    const Features features = bent_features(finger.bent);
    const MotionPerG change = finger.per_g - response.at_rest;
    const double size = (noise.cwiseInverse().asDiagonal() * change).norm();
    const double weight = std::pow(1 + size / kLargeChange, -2);
    normal += weight * features * features.transpose();
    right += weight * features * Eigen::Map<const Eigen::Matrix<double, 1, 3 * kPoseDims>>(change.data());
  }
  response.change = normal.ldlt().solve(right).transpose();
}

}  // namespace

GravityResponse gravity_response(const std::shared_ptr<const PushedFinger>& finger, const Scene& scene, int places) {
  GravityResponse response;
  const std::optional<MotionPerG> at_rest = FingerStatics(finger).motion_per_g();
  if (!at_rest) {
    throw std::runtime_error("the finger at rest does not resist every motion: is a part of it not attached?");
  }
  response.at_rest = *at_rest;
  const std::vector<Vec3f> points_mm = touch_points(finger->spec, places);
  std::vector<std::vector<BentFinger>> bent(points_mm.size());
  Progress progress("the bent finger's weight", points_mm.size());
  parallel_for(points_mm.size(), [&](std::size_t i) {
    Random random(0x9'0000 + i);
    FingerStatics statics(finger);
    bent[i] = bend(statics, finger->spec, scene, points_mm[i], random);
    progress.advance();
  });
  std::vector<BentFinger> all;
  for (const auto& of_place : bent) all.insert(all.end(), of_place.begin(), of_place.end());
  if (!all.empty()) fit_change(all, pose_noise(finger->spec.noise), response);
  return response;
}

}  // namespace finsight::host
