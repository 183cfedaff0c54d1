#include "hostgen/learn/touch_samples.h"

#include <doctest/doctest.h>

#include <cmath>
#include <optional>
#include <vector>

using namespace finsight;
using namespace finsight::host;

TEST_CASE("touch samples: one finger in five is turned as nobody knows, one in ten bent by what is left over") {
  // 1 g moves the top plate by 1 mm.
  std::vector<float> per_g(3 * kPoseDims, 0.0F), change(3 * kPoseDims * kBentFeatures, 0.0F);
  for (std::size_t axis = 0; axis < 3; ++axis) per_g[4 * axis] = 1;
  TouchModel model;
  model.per_g = per_g;
  model.per_g_change = change;
  const GravityCorrection gravity(model, std::nullopt);
  Random random(3);
  constexpr int kDraws = 20'000;
  double turned = 0, left_over = 0, turned_sq = 0, left_over_sq = 0;
  for (int i = 0; i < kDraws; ++i) {
    PoseVector numbers = PoseVector::Constant(2);
    const float unknown_g = add_gravity(gravity, random, numbers);
    CHECK(numbers.tail<kPoseDims - 3>() == PoseVector::Constant(2).tail<kPoseDims - 3>());
    const double moved_sq = double((numbers - PoseVector::Constant(2)).squaredNorm());
    if (unknown_g == GravityCorrection::kUnknown_g) {
      ++turned;
      turned_sq += moved_sq;
    } else if (unknown_g > 0) {
      ++left_over;
      left_over_sq += moved_sq / double(unknown_g * unknown_g);
    } else {
      CHECK(moved_sq == 0);
    }
  }
  CHECK(turned / kDraws == doctest::Approx(0.2).epsilon(0.02));
  CHECK(left_over / kDraws == doctest::Approx(0.1).epsilon(0.02));
  CHECK(turned_sq / turned == doctest::Approx(3).epsilon(0.03));  // 1 g at the zero; then half 1 g, half up to 3 g
  CHECK(left_over_sq / left_over == doctest::Approx(3).epsilon(0.03));  // along each of three axes
}
