#include "firmware/loop/finger_fit.h"

#include <doctest/doctest.h>

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
