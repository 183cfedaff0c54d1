#include "hostgen/fit/pack_error.h"

#include <doctest/doctest.h>

#include <cmath>

#include "tests/fem/box_mesh.h"
#include "tests/model/tiny_model.h"

using namespace finsight;
using namespace finsight::host;

namespace {

/// A pack that takes every touch of 2 mm of plate motion and more for this one.
Model always(const Vec3f& point_mm, float force_n) {
  test::TinyModel pack;
  pack.answer_always(point_mm, force_n);
  return pack.open();
}

/// What a pack that always says so gets wrong about a push at the middle of a small finger.
PackError error_of(double force_n) {
  FingerStatics statics(test::small_finger_spec(), test::small_finger_mesh());
  const PressedPlace place(statics, Vec3f(0, 50, 0), 1);
  const Model pack = always(Vec3f(3, 45, 0), 2);
  TouchStage stage(pack);
  return pack_error(place, force_n, Vec3f(0, 50, 0), stage);
}

}  // namespace

TEST_CASE("pack error: it is the difference between a push that was solved and what the pack says of it") {
  const PackError error = error_of(0.9);
  CHECK(error.touch_mm.isApprox(Vec3f(3, -5, 0)));
  CHECK(error.log_force == doctest::Approx(std::log(0.9 / 2)));
}

TEST_CASE("pack error: there is none where the pack publishes no touch") {
  for (const double force_n : {0.0, 1e-3}) {
    CHECK(error_of(force_n).touch_mm.isZero());
    CHECK(error_of(force_n).log_force == 0);
  }
}
