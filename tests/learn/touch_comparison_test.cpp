#include "hostgen/learn/touch_comparison.h"

#include <doctest/doctest.h>

#include "tests/learn/synthetic_finger.h"

using namespace finsight;
using namespace finsight::host;

TEST_CASE("touch comparison: every method of table 2 learns a smooth finger, and noise makes all of them worse") {
  const std::vector<MethodScore> scores =
      compare_methods(test::synthetic_spec(), test::synthetic_dataset(), {.steps = 300});
  REQUIRE(scores.size() == 5);
  const char* names[] = {"lr", "svm", "knn", "dt", "mlp"};
  for (std::size_t m = 0; m < scores.size(); ++m) {
    CAPTURE(scores[m].name);
    CHECK(scores[m].name == names[m]);
    CHECK(scores[m].random_clean.r2[1] > 0.6);
    CHECK(scores[m].held_out_clean.r2[1] > 0.3);
    CHECK(scores[m].random_noisy.rmse_mm[1] > scores[m].random_clean.rmse_mm[1]);
    CHECK(scores[m].train_s > 0);
    CHECK(scores[m].predict_us > 0);
  }
  CHECK(scores[1].random_clean.r2[1] > scores[0].random_clean.r2[1]);  // the finger is not linear
}

TEST_CASE("touch comparison: too few states are refused") {
  FemDataset dataset = test::synthetic_dataset();
  dataset.states.resize(40);
  CHECK_THROWS_AS(compare_methods(test::synthetic_spec(), dataset, {.steps = 1}), std::runtime_error);
}
