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

/// `change`: of the motion of number 0 for 1 g along z, per unit of number 7; `of_size`: of number 1, per unit of that
/// times the largest displacement.
GravityCorrection correction(const std::optional<Vec3f>& fixed_g = std::nullopt, float change = 0, float of_size = 0) {
  std::vector<float> changes(3 * kPoseDims * kBentFeatures, 0.0F);
  changes[2 * kBentFeatures + 7] = change;
  changes[5 * kBentFeatures + kPoseDims + 7] = of_size;
  TouchModel model;
  model.per_g = per_g();
  model.per_g_change = changes;
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
  CHECK(gravity.apply(true, poses) == doctest::Approx(0.03 + 0.04));
  // Of plate 1, numbers 6 to 11: z adds i + 200, the lost -y adds i + 100.
  CHECK(poses.plates[1].displacement_mm == Vec3f(-312, -314, -316));
  CHECK(poses.plates[1].rotation_rad == Vec3f(-318, -320, -322));
}

TEST_CASE("gravity: what is left grows with the square of the acceleration") {
  GravityCorrection gravity = correction();
  gravity.set_at_zero(kUp);
  PlatePoses poses;
  gravity.set_felt(Vec3f(3 * kUp));
  CHECK(gravity.apply(true, poses) == doctest::Approx(0.03 + 0.04 * 9));
}

TEST_CASE("gravity: without a zero the whole weight is taken out, as the model's rest is without any") {
  GravityCorrection gravity = correction();
  gravity.set_felt(kLevel);
  PlatePoses poses;
  CHECK(gravity.apply(false, poses) == doctest::Approx(0.03 + 0.04));
  CHECK(poses.plates[0].displacement_mm == Vec3f(-200, -201, -202));
}

TEST_CASE("gravity: what is not known is left in and said") {
  GravityCorrection gravity = correction();
  PlatePoses poses;
  CHECK(gravity.apply(false, poses) == GravityCorrection::kUnknown_g);
  gravity.set_felt(kLevel);  // but the zero was measured before that
  CHECK(gravity.apply(true, poses) == GravityCorrection::kUnknown_g);
  gravity.set_at_zero(kUp);
  gravity.set_felt(std::nullopt);
  CHECK(gravity.apply(true, poses) == GravityCorrection::kUnknown_g);
  CHECK(poses.plates[0].displacement_mm == Vec3f::Zero());
}

TEST_CASE("gravity: a finger that never turns needs nothing but its zero") {
  GravityCorrection gravity = correction(kUp);
  PlatePoses poses;
  CHECK(gravity.apply(true, poses) == 0);
  CHECK(poses.plates[0].displacement_mm == Vec3f::Zero());
  gravity.set_felt(std::nullopt);  // no client changes that
  gravity.set_at_zero(std::nullopt);
  CHECK(gravity.apply(false, poses) == doctest::Approx(0.04));
  CHECK(poses.plates[0].displacement_mm == Vec3f(100, 101, 102));
}

TEST_CASE("gravity: a bent finger answers otherwise than one at rest") {
  constexpr float kChange = 0.01F, kOfSize = 1e-5F;
  GravityCorrection gravity = correction(std::nullopt, kChange, kOfSize);
  gravity.set_at_zero(Vec3f(0, 0, 0));
  gravity.set_felt(kLevel);
  PlatePoses poses;
  poses.plates[1].displacement_mm.y() = 300;
  gravity.apply(true, poses);
  // 1 g along z has moved plate 1 by (206, 207, 208): it was at 93, and at 196.5 half-way.
  CHECK(poses.plates[1].displacement_mm.y() == 93);
  CHECK(poses.plates[0].displacement_mm.x() == doctest::Approx(-200 - kChange * 196.5));
  const float half_way_mm = Vec3f(-103, 196.5F, -104).norm();
  CHECK(half_way_mm > Vec3f(-106, -107, -108).norm());  // that of plate 2
  CHECK(poses.plates[0].displacement_mm.y() == doctest::Approx(-201 - kOfSize * half_way_mm * 196.5));
}

TEST_CASE("gravity: a finger that never turns is bent by its weight before and after it is touched") {
  constexpr float kChange = 0.01F;
  GravityCorrection gravity = correction(kLevel, kChange);
  PlatePoses poses;
  gravity.apply(true, poses);
  CHECK(poses.plates[0].displacement_mm.x() == doctest::Approx(0));
  poses.plates[1].displacement_mm.y() = 30;
  CHECK(gravity.apply(true, poses) == 0);
  CHECK(poses.plates[0].displacement_mm.x() == doctest::Approx(-30 * kChange));
  CHECK(poses.plates[1].displacement_mm.y() == doctest::Approx(30));
}
