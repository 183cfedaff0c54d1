#include "hostgen/learn/corner_measurement.h"

#include <doctest/doctest.h>

#include "hostgen/learn/state_interpolant.h"
#include "hostgen/learn/touch_training.h"
#include "tests/learn/synthetic_finger.h"

using namespace finsight;
using namespace finsight::host;

namespace {

const FingerSpec kSpec = test::synthetic_spec();

const PlatePriorData& prior() {
  static const PlatePriorData fitted = fit_plate_prior(test::synthetic_dataset(), kSpec.noise);
  return fitted;
}

}  // namespace

TEST_CASE("corner measurement: its errors are as large as the noise that it states") {
  const CornerMeasurement camera(kSpec, prior().view());
  Random random(1);
  const auto& states = test::synthetic_dataset().states;
  std::array<double, kPlates> sum_sq{};  // of errors over their stated deviation, so that every state counts the same
  for (const FemState& state : states) {
    const PoseVector truth = touch_sample(state).numbers;
    PoseVector numbers = truth;
    const auto noise = camera.measure({true, true, true}, random, numbers);
    for (int n = 0; n < kPoseDims; ++n) {
      const auto k = static_cast<std::size_t>(n);
      const float stated = noise[k / 6] * prior().noise[k];
      sum_sq[k / 6] += std::pow(static_cast<double>((numbers[n] - truth[n]) / stated), 2);
    }
  }
  for (std::size_t p = 0; p < kPlates; ++p) {
    CAPTURE(p);
    CHECK(std::sqrt(sum_sq[p] / (6 * static_cast<double>(states.size()))) == doctest::Approx(1).epsilon(0.1));
  }
}

TEST_CASE("corner measurement: a plate that is not seen is completed, and stays within the finger's reach") {
  const CornerMeasurement camera(kSpec, prior().view());
  Random random(2);
  for (const FemState& state : test::synthetic_dataset().states) {
    PoseVector numbers = touch_sample(state).numbers;
    camera.measure({true, false, true}, random, numbers);
    CHECK(numbers.allFinite());
    CHECK((numbers - touch_sample(state).numbers).segment<3>(6).norm() < 8);
  }
}
