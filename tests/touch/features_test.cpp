#include "firmware/touch/features.h"

#include <doctest/doctest.h>

#include <cmath>
#include <vector>

using namespace finsight;

namespace {

// Scale 1, no normalisation.
struct PlainModel {
  std::vector<float> ones = std::vector<float>(TouchModel::kInputs, 1),
                     zeros = std::vector<float>(TouchModel::kInputs, 0);
  TouchModel model;
  PlainModel() {
    model.scale = std::span(ones).first(kPoseDims);
    model.input_mean = zeros;
    model.input_scale = ones;
  }
};

PoseVector some_numbers() {
  PoseVector numbers;
  for (int i = 0; i < kPoseDims; ++i) numbers[i] = std::sin(1.0f + float(i));
  return numbers;
}

}  // namespace

TEST_CASE("features: the direction has length one, size, noise and unknown gravity are logarithms") {
  const PlainModel plain;
  std::array<float, TouchModel::kInputs> inputs, twice;
  touch_features(plain.model, some_numbers(), {1, 100, 0.1f}, 0.3F, inputs);
  touch_features(plain.model, 2 * some_numbers(), {1, 1, 1}, 0, twice);
  float length_sq = 0;
  for (std::size_t i = 0; i < kPoseDims; ++i) {
    length_sq += inputs[i] * inputs[i];
    CHECK(twice[i] == doctest::Approx(double(inputs[i])).epsilon(1e-3));
  }
  CHECK(length_sq == doctest::Approx(1).epsilon(1e-3));
  CHECK(double(inputs[kPoseDims]) == doctest::Approx(std::log(double(some_numbers().norm()) + 1e-3)));
  CHECK(double(twice[kPoseDims] - inputs[kPoseDims]) == doctest::Approx(std::log(2)).epsilon(1e-3));
  CHECK(inputs[19] == 0);
  CHECK(double(inputs[20]) == doctest::Approx(std::log(100)));
  CHECK(double(inputs[21]) == doctest::Approx(std::log(0.1)));
  CHECK(double(inputs[22]) == doctest::Approx(std::log(0.3)));
  CHECK(double(twice[22]) == doctest::Approx(std::log(double(kMinUnknown_g))));
  touch_features(plain.model, some_numbers(), {1, 1, 1}, 20, twice);
  CHECK(double(twice[22]) == doctest::Approx(std::log(double(kMaxUnknown_g))));
}

TEST_CASE("features: at rest they are finite") {
  const PlainModel plain;
  std::array<float, TouchModel::kInputs> inputs;
  touch_features(plain.model, PoseVector::Zero(), {1, 1, 1}, 0, inputs);
  for (std::size_t i = 0; i < kPoseDims; ++i) CHECK(inputs[i] == 0);
  CHECK(double(inputs[kPoseDims]) == doctest::Approx(std::log(1e-3)));
}

TEST_CASE("features: scale is applied before the direction, mean and input scale after it") {
  PlainModel plain;
  std::vector<float> scale(kPoseDims, 1), mean(TouchModel::kInputs, 0.5f), factor(TouchModel::kInputs, 3);
  scale[3] = 20;
  plain.model.scale = scale;
  plain.model.input_mean = mean;
  plain.model.input_scale = factor;
  PoseVector numbers = PoseVector::Zero();
  numbers[0] = 3;
  numbers[3] = 0.2f;  // scaled 4: the direction is 0.6, 0.8
  std::array<float, TouchModel::kInputs> inputs;
  touch_features(plain.model, numbers, {1, 1, 1}, 0, inputs);
  CHECK(double(inputs[0]) == doctest::Approx(3 * (0.6 - 0.5)).epsilon(2e-3));
  CHECK(double(inputs[3]) == doctest::Approx(3 * (0.8 - 0.5)).epsilon(2e-3));
  CHECK(double(inputs[19]) == doctest::Approx(-1.5));
}

TEST_CASE("features: unseen plates have a noise of their own, that of others is limited to the trained range") {
  PlatePoses poses;
  poses.seen = {true, false, true};
  poses.noise = {1e-6f, 1, 1e6f};
  CHECK(network_noise(poses) == std::array{kMinNoise, kUnseenNoise, kMaxNoise});
}
