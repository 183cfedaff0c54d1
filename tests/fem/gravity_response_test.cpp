#include "hostgen/fem/gravity_response.h"

#include <doctest/doctest.h>

#include <cmath>

#include "hostgen/fem/statics.h"
#include "tests/fem/box_mesh.h"

using namespace finsight;
using namespace finsight::host;

namespace {

FingerSpec noisy_spec() {
  FingerSpec spec = test::small_finger_spec();
  for (PoseNoise& noise : spec.noise) noise = {0.01, 0.05, 0.005, 0.001};
  spec.density_kg_m3 = 1150;
  return spec;
}

}  // namespace

TEST_CASE("gravity response: is what equilibrium tends to for small accelerations, in any direction") {
  const auto finger = std::make_shared<const PushedFinger>(noisy_spec(), test::small_finger_mesh());
  const Eigen::Matrix<double, kPoseDims, 3> per_g = motion_per_g(*finger);
  for (const Eigen::Vector3d& felt_g :
       {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 0, 1), Eigen::Vector3d(0.5, -1, 0.3)}) {
    FingerStatics statics(finger);
    statics.begin({{.centre_mm = {2, 42}, .radius_mm = 2}}, felt_g);
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
  const FingerSpec spec = noisy_spec();
  const PushedFinger finger(spec, test::small_finger_mesh());
  const Eigen::Matrix<double, kPoseDims, 3> per_g = motion_per_g(finger);
  const double volume_mm3 = 12 * 60 * 6;
  CHECK(finger.mass_kg() == doctest::Approx(1150e-9 * volume_mm3));
  // A clamped column under its own weight sideways, w L^4 / (8 E I) at the end; its plates make it stiffer.
  const double weight_n_mm = 9.80665 * 1150e-9 * volume_mm3 / 60, inertia_mm4 = 12 * 6 * 6 * 6 / 12.0;
  const double end_mm = weight_n_mm * 60 * 60 * 60 * 60 / (8 * 10 * inertia_mm4);
  const double top_mm = per_g(2, 2);
  CHECK(top_mm > 0.4 * end_mm);
  CHECK(top_mm < end_mm);
  CHECK(std::abs(per_g(0, 2)) < 0.05 * top_mm);
}
