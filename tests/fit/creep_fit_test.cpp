#include "hostgen/fit/creep_fit.h"

#include <doctest/doctest.h>

#include <cmath>

#include "hostgen/util/random.h"

using namespace finsight::host;

namespace {

constexpr double kShare = 0.12, kAfter_s = 18;

/// A minute under a constant force, a reading every tenth of a second.
ForceSeries minute(double force_n, Random& random) {
  ForceSeries series;
  for (double after_s = 0.5; after_s < 60; after_s += 0.1) {
    series.after_s.push_back(after_s);
    const double crept = 1 - kShare * std::expm1(-after_s / kAfter_s);
    series.force_n.push_back(force_n * (crept + 0.01 * random.normal()));
  }
  return series;
}

}  // namespace

TEST_CASE("creep fit: finds one creep in holds of different forces, and says how well") {
  Random random(3);
  const auto creep = fit_creep({minute(2, random), minute(5, random)});
  REQUIRE(creep);
  CHECK(creep->after_s == doctest::Approx(kAfter_s).epsilon(0.15));
  CHECK(creep->sigma < 0.01);
  CHECK(std::abs(creep->share - kShare) < 5 * creep->sigma);
}

TEST_CASE("creep fit: forces are read without what they crept") {
  Random random(4);
  const ForceSeries hold = minute(3, random);
  CHECK(mean_without_creep(hold, Creep{kShare, kAfter_s, 0}) == doctest::Approx(3).epsilon(0.003));
  CHECK(mean_without_creep(hold, std::nullopt) > 3.2);
}

TEST_CASE("creep fit: nothing that lasted tells nothing") { CHECK(!fit_creep({})); }
