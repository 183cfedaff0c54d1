#include "hostgen/render/virtual_finger.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>

#include "firmware/geometry/so3.h"
#include "hostgen/finger/grid.h"

using namespace finsight;
using namespace finsight::host;

namespace {

const FingerSpec& srm() {
  static const FingerSpec spec = read_finger_spec(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml");
  return spec;
}

}  // namespace

TEST_CASE("virtual finger: a number gives the same finger, another one another, all inside the workshop's ranges") {
  const Workshop workshop;
  CHECK(draw_finger(srm(), 3).spec.front_wall_mm == draw_finger(srm(), 3).spec.front_wall_mm);
  CHECK(draw_finger(srm(), 3).spec.front_wall_mm != draw_finger(srm(), 4).spec.front_wall_mm);
  double thinnest_mm = 1e9, thickest_mm = 0;
  for (std::uint64_t number = 0; number < 100; ++number) {
    const VirtualFinger finger = draw_finger(srm(), number);
    CHECK_NOTHROW(check_shape(finger.spec));
    CHECK(std::abs(finger.spec.back_wall_mm - srm().back_wall_mm) <= workshop.wall_mm);
    thinnest_mm = std::min(thinnest_mm, finger.spec.front_wall_mm);
    thickest_mm = std::max(thickest_mm, finger.spec.front_wall_mm);
    CHECK(finger.spec.youngs_modulus_mpa >= 7);
    CHECK(finger.spec.youngs_modulus_mpa <= 13);
    const Eigen::Isometry3d off = srm().T_finger_camera.inverse() * finger.spec.T_finger_camera;
    CHECK(off.translation().norm() <= workshop.camera_mm);
    CHECK(so3_log(Eigen::Matrix3d(off.linear())).norm() <= workshop.camera_deg / 57.29);
    CHECK(std::abs(finger.spec.cameras[0].cx - srm().cameras[0].cx) <= workshop.principal_point_px);
  }
  CHECK(thickest_mm - thinnest_mm > 1.8 * workshop.wall_mm);
}

TEST_CASE(
    "virtual finger: a lasting force bends it further as stated, and all of it comes back but what hysteresis keeps") {
  for (const double creep : {0.05, 0.15}) {
    MaterialMemory memory(creep, 20, 0, 6);
    CHECK(memory.bends_as_n(4, 1e-6) == doctest::Approx(4).epsilon(1e-4));
    CHECK(memory.bends_as_n(4, 20) == doctest::Approx(4 * (1 + creep * (1 - std::exp(-1)))));
    CHECK(memory.bends_as_n(4, 1e6) == doctest::Approx(4 * (1 + creep)));
    CHECK(std::abs(memory.bends_as_n(0, 1e6)) < 1e-9);
  }
}

TEST_CASE("virtual finger: the gap between loading and unloading is the stated share of the full force") {
  constexpr double kHysteresis = 0.08, kFull_n = 6;
  MaterialMemory memory(0, 10, kHysteresis, kFull_n);
  std::vector<double> up(61);
  for (int i = 0; i <= 60; ++i) up[static_cast<std::size_t>(i)] = memory.bends_as_n(0.1 * i, 0.1);
  double widest_n = 0;
  for (int i = 60; i >= 0; --i) {
    widest_n = std::max(widest_n, memory.bends_as_n(0.1 * i, 0.1) - up[static_cast<std::size_t>(i)]);
  }
  CHECK(widest_n == doctest::Approx(kHysteresis * kFull_n).epsilon(0.15));
}

TEST_CASE("virtual finger: a wall grows to its inside, and plates stay where they are in its depth") {
  const FingerSpec thick = with_walls(srm(), 0.3, 0.3, 0);
  CHECK(thick.front_z.at_base_mm == srm().front_z.at_base_mm);
  for (int p = 0; p < kPlates; ++p) {
    const auto i = static_cast<std::size_t>(p);
    const double y_mm = plate_bottom_mm(srm(), p);
    const auto front_end_mm = [&](const FingerSpec& spec) {
      const double front_mm = inner_front_mm(spec, y_mm);
      return front_mm + spec.plates[i].deep[0] * (inner_back_mm(spec, y_mm) - front_mm);
    };
    CHECK(front_end_mm(thick) == doctest::Approx(front_end_mm(srm())));
  }
}
