#include "firmware/loop/gravity.h"

#include <doctest/doctest.h>

#include <cmath>
#include <vector>

using namespace finsight;

namespace {

/// 1 g along axis a moves number i by i + 100 a.
const std::vector<float>& per_g() {
  static const std::vector<float> numbers = [] {
    std::vector<float> values;
    for (int i = 0; i < kPoseDims; ++i) {
      for (int axis = 0; axis < 3; ++axis) values.push_back(static_cast<float>(i + 100 * axis));
    }
    return values;
  }();
  return numbers;
}

GravityCorrection correction(const std::optional<Vec3f>& fixed_g = std::nullopt) {
  TouchModel model;
  model.per_g = per_g();
  return {model, fixed_g};
}

const Vec3f kUp(0, -1, 0), kLevel(0, 0, 1);

}  // namespace

TEST_CASE("gravity: what a turn since the zero bends is taken out") {
  GravityCorrection gravity = correction();
  gravity.set_felt(kUp);
  gravity.set_at_zero(gravity.felt());
  gravity.set_felt(kLevel);
  PlatePoses poses;
  CHECK(gravity.apply(true, poses) == doctest::Approx(0.03 + 0.09 * std::sqrt(2.0) + 0.05 * 2));
  // Of plate 1, numbers 6 to 11: z adds i + 200, the lost -y adds i + 100.
  CHECK(poses.plates[1].displacement_mm == Vec3f(-312, -314, -316));
  CHECK(poses.plates[1].rotation_rad == Vec3f(-318, -320, -322));
}

TEST_CASE("gravity: what grows with the square of the acceleration is the same after a turn by 180 degrees") {
  GravityCorrection gravity = correction();
  gravity.set_at_zero(kUp);
  PlatePoses poses;
  gravity.set_felt(Vec3f(-kUp));
  CHECK(gravity.apply(true, poses) == doctest::Approx(0.03 + 0.09 * 2));
  gravity.set_felt(Vec3f(3 * kUp));
  CHECK(gravity.apply(true, poses) == doctest::Approx(0.03 + 0.09 * 2 + 0.05 * 8));
}

TEST_CASE("gravity: without a zero the whole weight is taken out, as the model's rest is without any") {
  GravityCorrection gravity = correction();
  gravity.set_felt(kLevel);
  PlatePoses poses;
  CHECK(gravity.apply(false, poses) == doctest::Approx(0.17));
  CHECK(poses.plates[0].displacement_mm == Vec3f(-200, -201, -202));
}

TEST_CASE("gravity: what is not known is left in and said") {
  GravityCorrection gravity = correction();
  PlatePoses poses;
  CHECK(gravity.apply(false, poses) == GravityCorrection::kUnknown_g);
  gravity.set_felt(kLevel);  // but the zero was measured before that
  CHECK(gravity.apply(true, poses) == GravityCorrection::kUnknownSinceZero_g);
  gravity.set_at_zero(kUp);
  gravity.set_felt(std::nullopt);
  CHECK(gravity.apply(true, poses) == GravityCorrection::kUnknownSinceZero_g);
  CHECK(poses.plates[0].displacement_mm == Vec3f::Zero());
}

TEST_CASE("gravity: a finger that never turns needs nothing but its zero") {
  GravityCorrection gravity = correction(kUp);
  PlatePoses poses;
  CHECK(gravity.apply(true, poses) == 0);
  CHECK(poses.plates[0].displacement_mm == Vec3f::Zero());
  gravity.set_felt(std::nullopt);  // no client changes that
  gravity.set_at_zero(std::nullopt);
  CHECK(gravity.apply(false, poses) == doctest::Approx(0.14));
  CHECK(poses.plates[0].displacement_mm == Vec3f(100, 101, 102));
}
