#include "hostgen/fem/gravity_response.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "tests/fem/box_mesh.h"

using namespace finsight;
using namespace finsight::host;

namespace {

FingerSpec noisy_spec() {
  FingerSpec spec = test::small_finger_spec();
  for (PoseNoise& noise : spec.noise) noise = {0.001, 0.001, 0.0001, 0.0001};
  spec.density_kg_m3 = 1150;
  return spec;
}

std::shared_ptr<const PushedFinger> small_finger(const FingerSpec& spec = noisy_spec()) {
  return std::make_shared<const PushedFinger>(spec, test::small_finger_mesh());
}

Scene rubbing() { return {.name = "grasp", .friction = 0.6}; }

PoseVectorOf<double> plates_of(const FingerStatics& statics) {
  return pose_vector(PlatePoses{.plates = statics.state().plates}).cast<double>();
}

/// Of what a bent finger answers to acceleration otherwise than one at rest: the share that the response does not tell,
/// of squares.
double share_left(const std::shared_ptr<const PushedFinger>& finger, const GravityResponse& response, double force_n) {
  const Eigen::Vector3d felt_g(0.7, -0.4, 1.1);
  double left = 0, changed = 0;
  for (const double y_mm : {22.0, 37.0, 52.0}) {
    const FaceContact contact{.centre_mm = {1, y_mm}, .friction = {0.1, 0.2}, .follow = 0};
    FingerStatics light(finger), heavy(finger);
    REQUIRE(light.begin({contact}));
    REQUIRE(heavy.begin({contact}, felt_g));
    REQUIRE(light.press(force_n));
    REQUIRE(heavy.press(force_n));
    const PoseVectorOf<double> moved = plates_of(heavy) - plates_of(light), first = response.at_rest * felt_g;
    const PoseVectorOf<double> half_way = 0.5 * (plates_of(heavy) + plates_of(light));
    const Eigen::Matrix<double, 3 * kPoseDims, 1> change = response.change * bent_features(half_way);
    const PoseVectorOf<double> told = first + Eigen::Map<const MotionPerG>(change.data()) * felt_g;
    left += (moved - told).squaredNorm();
    changed += (moved - first).squaredNorm();
  }
  return left / changed;
}

/// The median over responses that were fitted to more and fewer places. How well one of them tells of the three touches
/// of share_left() depends on the states that it drew.
double usual_share_left(const std::shared_ptr<const PushedFinger>& finger, double force_n) {
  std::array<double, 5> shares;
  for (std::size_t i = 0; i < shares.size(); ++i) {
    const int places = 30 + 5 * static_cast<int>(i);
    shares[i] = share_left(finger, gravity_response(finger, rubbing(), places), force_n);
  }
  std::ranges::sort(shares);
  return shares[shares.size() / 2];
}

}  // namespace

TEST_CASE("gravity response: is what equilibrium tends to for small accelerations, in any direction") {
  const auto finger = small_finger();
  const MotionPerG per_g = gravity_response(finger, rubbing(), 1).at_rest;
  for (const Eigen::Vector3d& felt_g :
       {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 0, 1), Eigen::Vector3d(0.5, -1, 0.3)}) {
    FingerStatics statics(finger);
    REQUIRE(statics.begin({{.centre_mm = {2, 42}, .radius_mm = 2}}, felt_g));
    REQUIRE(statics.press(1e-9));
    const FemState state = statics.state();
    const PoseVectorOf<double> expected = per_g * felt_g;
    for (int p = 0; p < kPlates; ++p) {
      const PlateMotion& plate = state.plates[static_cast<std::size_t>(p)];
      CHECK((plate.displacement_mm.cast<double>() - expected.segment<3>(6 * p)).norm() <
            0.02 * expected.segment<3>(6 * p).norm());
      CHECK((plate.rotation_rad.cast<double>() - expected.segment<3>(6 * p + 3)).norm() <
            0.03 * expected.segment<3>(6 * p + 3).norm());
    }
  }
}

TEST_CASE("gravity response: bends the finger as its weight does") {
  const auto finger = small_finger();
  const MotionPerG per_g = gravity_response(finger, rubbing(), 1).at_rest;
  const double volume_mm3 = 12 * 60 * 6;
  CHECK(finger->mass_kg() == doctest::Approx(1150e-9 * volume_mm3));
  // A clamped column under its own weight sideways, w L^4 / (8 E I) at the end; its plates make it stiffer.
  const double weight_n_mm = 9.80665 * 1150e-9 * volume_mm3 / 60, inertia_mm4 = 12 * 6 * 6 * 6 / 12.0;
  const double end_mm = weight_n_mm * 60 * 60 * 60 * 60 / (8 * 10 * inertia_mm4);
  const double top_mm = per_g(2, 2);
  CHECK(top_mm > 0.4 * end_mm);
  CHECK(top_mm < end_mm);
  CHECK(std::abs(per_g(0, 2)) < 0.05 * top_mm);
}

TEST_CASE("gravity response: tells what a bent finger answers otherwise than one at rest") {
  CHECK(usual_share_left(small_finger(), 0.3) < 0.1);
}

TEST_CASE("gravity response: fingers about to snap through do not decide what is told of others") {
  FingerSpec spec = noisy_spec();
  spec.force_n = {0.1, 8};
  CHECK(usual_share_left(small_finger(spec), 0.1) < 0.06);
}

TEST_CASE("gravity response: a finger that does not bear much acceleration tells what it does at rest") {
  FingerSpec spec = noisy_spec();
  spec.density_kg_m3 = 1e6;
  const GravityResponse response = gravity_response(small_finger(spec), rubbing(), 3);
  CHECK(response.at_rest.norm() > 0);
  CHECK(response.change.allFinite());
}
