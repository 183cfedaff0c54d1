#include "firmware/loop/finger_fit.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>

using namespace finsight;

namespace {

constexpr std::int64_t kFrame_ns = kNsPerS / 60;

Touch touch_of(float force_n) {
  return {.point_mm = Vec3f(5, 60, -15),
          .contact_mm = Vec3f(5, 60, -12),
          .radius_68_mm = 1,
          .force_n = force_n,
          .force_sigma_n = 0.2F,
          .force_vector_n = Vec3f(force_n, 0.1F, 0.2F),
          .moment_nm = Vec3f(0.1F, 0, 0),
          .quality = Quality::kFresh};
}

}  // namespace

TEST_CASE("finger fit: force, its parts, its moment and their deviations are scaled alike") {
  FitValues values;
  values.force_scale = 1.25F;
  FingerFit fit(values);
  Touch touch = touch_of(4);
  fit.apply(Eigen::Matrix3f::Identity(), kFrame_ns, touch);
  CHECK(touch.force_n == doctest::Approx(5));
  CHECK(touch.force_sigma_n == doctest::Approx(0.25));
  CHECK(touch.force_vector_n.y() == doctest::Approx(0.125));
  CHECK(touch.moment_nm.x() == doctest::Approx(0.125));
  CHECK(touch.point_mm == Vec3f(5, 60, -15));
}

TEST_CASE("finger fit: a force that lasts stays what it was, though the finger creeps") {
  FitValues values;
  values.creep_share = 0.12F;
  values.creep_s = 15;
  FingerFit fit(values);
  float lowest_n = 10, highest_n = 0;
  for (int frame = 1; frame <= 90 * 60; ++frame) {
    const double bends_as_n = 3 * (1 + 0.12 * (1 - std::exp(-frame / 60.0 / 15)));
    Touch touch = touch_of(static_cast<float>(bends_as_n));
    fit.apply(Eigen::Matrix3f::Identity(), frame * kFrame_ns, touch);
    lowest_n = std::min(lowest_n, touch.force_n);
    highest_n = std::max(highest_n, touch.force_n);
  }
  CHECK(lowest_n > 2.99F);
  CHECK(highest_n < 3.01F);
}

TEST_CASE("finger fit: what has crept is forgotten while nothing touches the finger") {
  FitValues values;
  values.creep_share = 0.2F;
  values.creep_s = 10;
  FingerFit fit(values);
  for (int frame = 1; frame <= 60 * 60; ++frame) {
    Touch touch = touch_of(3.6F);
    fit.apply(Eigen::Matrix3f::Identity(), frame * kFrame_ns, touch);
  }
  for (int frame = 1; frame <= 60 * 60; ++frame) {
    Touch none;
    fit.apply(Eigen::Matrix3f::Identity(), (3600 + frame) * kFrame_ns, none);
    CHECK(none.quality == Quality::kInvalid);
  }
  Touch touch = touch_of(3);
  fit.apply(Eigen::Matrix3f::Identity(), 7201 * kFrame_ns, touch);
  CHECK(touch.force_n == doctest::Approx(3).epsilon(0.005));
}

TEST_CASE("hysteresis: what bends the finger and what it bends it like are each other's inverse on any path") {
  FitValues values;
  values.hysteresis = 0.1F;
  values.force_range_n = 6;
  Hysteresis material(values);
  float force_n = 0;
  for (int frame = 0; frame < 400; ++frame) {
    force_n = 3 - 3 * std::cos(0.1F * static_cast<float>(frame)) * std::cos(0.013F * static_cast<float>(frame));
    CHECK(material.force_n(material.elastic_n(force_n)) == doctest::Approx(force_n).epsilon(1e-4));
  }
}

TEST_CASE("finger fit: a force reads alike whether it grew or fell, of a material whose plays are others") {
  constexpr std::array<float, 6> kWidths_n = {0.1F, 0.25F, 0.5F, 0.9F, 1.5F, 2.2F};
  constexpr float kRange_n = 6, kWeight = 0.065F * kRange_n / 2 / 4.75F;  // the last two turn round in part
  std::array<float, 6> plays_n{};
  const auto bends_as_n = [&](float force_n) {
    float elastic_n = force_n;
    for (std::size_t i = 0; i < plays_n.size(); ++i) {
      plays_n[i] = std::clamp(plays_n[i], force_n - kWidths_n[i], force_n + kWidths_n[i]);
      elastic_n += kWeight * (plays_n[i] - force_n);
    }
    return elastic_n;
  };
  FitValues values;
  values.hysteresis = 0.065F;
  values.force_range_n = kRange_n;
  FingerFit fit(values);
  float gap_n = 0, worst_n = 0;
  for (int frame = 1; frame <= 480; ++frame) {  // twice: the first touch leaves something behind for the second
    const int step = frame % 240;
    const float force_n = 0.05F * static_cast<float>(step <= 120 ? step : 240 - step);
    Touch touch = touch_of(bends_as_n(force_n));
    gap_n = std::max(gap_n, std::abs(touch.force_n - force_n));
    fit.apply(Eigen::Matrix3f::Identity(), frame * kFrame_ns, touch);
    worst_n = std::max(worst_n, std::abs(touch.force_n - force_n));
  }
  CHECK(gap_n > 0.2F);
  CHECK(worst_n < 0.1F);
}

TEST_CASE("finger fit: a force that has turned round is not noisier for its hysteresis") {
  FitValues values;
  values.hysteresis = 0.1F;
  values.force_range_n = 6;
  Hysteresis material(values);
  FingerFit fit(values);
  float force_n = 0, from_n = 10, to_n = 0;
  for (int frame = 1; frame <= 360; ++frame) {  // up to 4 N, back to 3.5 N within what the widest play lags, and there
    force_n = frame <= 120 ? static_cast<float>(frame) / 30 : std::max(4 - static_cast<float>(frame - 120) / 60, 3.5F);
    material.follow(force_n);
    const bool stands = frame > 240;
    Touch touch = touch_of(material.elastic_n(force_n) + (stands ? (frame % 2 == 0 ? 0.1F : -0.1F) : 0));
    fit.apply(Eigen::Matrix3f::Identity(), frame * kFrame_ns, touch);
    if (!stands) continue;
    from_n = std::min(from_n, touch.force_n);
    to_n = std::max(to_n, touch.force_n);
  }
  CHECK(to_n - from_n < 0.22F);
  CHECK((from_n + to_n) / 2 == doctest::Approx(3.5).epsilon(0.01));
}

TEST_CASE("finger fit: the touch's offset is taken off along the face") {
  FitValues values;
  values.across_mm = {0.5F, 0, 0, 0};
  values.along_mm = {1, 0, 2, 0};
  values.face_middle_mm = Vec3f(0, 40, 0);
  values.face_half_mm = {20, 40};
  Eigen::Matrix3f axes;  // normal, across, along
  axes << 0, 1, 0, -0.6F, 0, 0.8F, 0.8F, 0, 0.6F;
  FingerFit fit(values);
  Touch touch = touch_of(3);
  fit.apply(axes, kFrame_ns, touch);
  CHECK(touch.point_mm.x() == doctest::Approx(4.5));
  CHECK(touch.point_mm.y() == doctest::Approx(60 - 2 * 0.8));  // v = 0.5 there
  CHECK(touch.point_mm.z() == doctest::Approx(-15 - 2 * 0.6));
  CHECK((touch.contact_mm - touch.point_mm - Vec3f(0, 0, 3)).norm() < 1e-4F);
}

TEST_CASE("finger fit: motions are changed by a linear function of themselves, and nothing else of the poses is") {
  FitValues values;
  values.motion_change(0, 3) = 2;  // a marker beside its place
  values.motion_change(8, 8) = -0.5F;
  PlatePoses poses;
  poses.plates[0] = {Vec3f(1, 2, 3), Vec3f(0.1F, 0, 0)};
  poses.plates[1].displacement_mm = Vec3f(0, 0, 4);
  poses.quality = Quality::kFresh;
  poses.noise = {1, 2, 3};
  FingerFit(values).change_motions(poses);
  CHECK(poses.plates[0].displacement_mm.isApprox(Vec3f(1.2F, 2, 3)));
  CHECK(poses.plates[0].rotation_rad.isApprox(Vec3f(0.1F, 0, 0)));
  CHECK(poses.plates[1].displacement_mm.isApprox(Vec3f(0, 0, 2)));
  CHECK(poses.quality == Quality::kFresh);
  CHECK(poses.noise[2] == 3);
}
