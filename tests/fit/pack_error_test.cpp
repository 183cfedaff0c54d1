#include "hostgen/fit/pack_error.h"

#include <doctest/doctest.h>

#include <cmath>

#include "hostgen/fit/pressed_place.h"
#include "tests/model/tiny_model.h"

using namespace finsight;
using namespace finsight::host;

namespace {

/// A pack that takes every touch of 2 mm of plate motion and more for this one.
Model always(const Vec3f& point_mm, float force_n) {
  test::TinyModel pack;
  for (std::size_t i = 0; i < 3; ++i) {
    std::ranges::fill(pack.weights[i], std::int8_t{0});
    std::ranges::fill(pack.bias[i], 0.0F);
  }
  std::copy(point_mm.data(), point_mm.data() + 3, pack.output_mean.begin());
  pack.output_mean[6] = force_n;
  return pack.open();
}

}  // namespace

TEST_CASE("pack error: lies between those of the pushes, and stays the outermost one's beyond them") {
  const std::vector<PackError> pushes = {{.pack_force_n = 1, .touch_mm = {0, 1, 0}, .log_force = 0.2},
                                         {.pack_force_n = 3, .touch_mm = {2, 3, 0}, .log_force = -0.2}};
  const PackError between = pack_error_at(pushes, 1.5);
  CHECK(between.touch_mm.isApprox(Vec3f(0.5F, 1.5F, 0)));
  CHECK(between.log_force == doctest::Approx(0.1));
  CHECK(pack_error_at(pushes, 0.5).log_force == doctest::Approx(0.2));
  CHECK(pack_error_at(pushes, 9).touch_mm.isApprox(Vec3f(2, 3, 0)));
}

TEST_CASE("pack error: a hole at which no push is an equilibrium tells none") {
  CHECK(pack_error_at({}, 2).touch_mm.isZero());
  CHECK(pack_error_at({}, 2).log_force == 0);
}

TEST_CASE("pack error: it is the difference between a push that was solved and what the pack says of it") {
  const FingerSpec spec = read_finger_spec(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml");
  const std::vector<JigHole> holes = {jig_holes(spec).back()};
  const Vec3f hole_mm = holes[0].contact_mm.cast<float>(), said_mm(3, 100, 0);
  const auto errors = pack_errors(spec, always(said_mm, 2), holes);

  FingerStatics statics(spec, make_mesh(spec));
  const PressedPlace place(statics, hole_mm, 1.5 * spec.force_n[1]);
  double published_n = 0;  // the weakest push that the pack takes for a touch
  const auto moves = [&](double force_n) {
    const auto plates = place.plates(force_n);
    return std::ranges::any_of(plates, [](const PlateMotion& plate) { return plate.displacement_mm.norm() >= 2; });
  };
  for (int i = 10; i > 0 && moves(place.highest_n() * i / 10); --i) published_n = place.highest_n() * i / 10;
  REQUIRE(published_n > 0);
  REQUIRE(errors.size() == 1);
  REQUIRE(errors[0].size() == 1);  // stronger pushes are no stronger for this pack
  CHECK(errors[0][0].pack_force_n == 2);
  CHECK(errors[0][0].touch_mm.isApprox(said_mm - hole_mm));
  CHECK(errors[0][0].log_force == doctest::Approx(std::log(published_n / 2)));
}
