#include "hostgen/fit/pack_error.h"

#include <doctest/doctest.h>

using namespace finsight;
using namespace finsight::host;

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
