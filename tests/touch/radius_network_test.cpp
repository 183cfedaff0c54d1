#include "firmware/touch/radius_network.h"

#include <doctest/doctest.h>

#include <vector>

#include "hostgen/learn/touch_training.h"

using namespace finsight;
using namespace finsight::host;

namespace {

/// y = weights x + bias in doubles.
std::vector<double> layer_of(const LayerData& layer, const std::vector<double>& x) {
  std::vector<double> y;
  for (std::size_t o = 0; o < layer.bias.size(); ++o) {
    y.push_back(double(layer.bias[o]));
    for (std::size_t i = 0; i < x.size(); ++i) y[o] += double(layer.weights[o * x.size() + i]) * x[i];
  }
  return y;
}

Touch some_touch() {
  Touch touch;
  touch.point_mm = Vec3f(3, 70, -1);
  touch.plate_motion_mm = 5;
  touch.force_vector_n = Vec3f(2, 0.5F, -1);
  touch.force_vector_sigma_n = Vec3f(0.1F, 0.2F, 0.6F);
  return touch;
}

/// Weights that differ from one another.
TouchModelData some_model() {
  TouchModelData model;
  const auto fill = [](std::vector<float>& numbers, float step) {
    for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] = step * static_cast<float>(i % 11) - 4 * step;
  };
  fill(model.radius_inputs, 0.1F);
  for (LayerData& layer : model.radius) {
    fill(layer.weights, 0.05F);
    fill(layer.bias, 0.03F);
  }
  return model;
}

}  // namespace

TEST_CASE(
    "radius network: its features tell place, motion, odds, friction, radius, deviations and gravity at any force") {
  const RadiusFeatures features = radius_features(some_touch(), 1.5F, 2, 0.1F);
  CHECK(features[0] == 3);
  CHECK(features[1] == 70);
  CHECK(features[2] == doctest::Approx(std::log(5.0)));
  CHECK(features[3] == 1.5F);
  CHECK(features[4] == 0.25F);
  CHECK(features[5] == -0.5F);
  CHECK(features[6] == doctest::Approx(std::log(2.0)));
  CHECK(features[7] == doctest::Approx(std::log(0.1)));
  CHECK(features[9] == doctest::Approx(std::log(0.6)));
  CHECK(features[10] == doctest::Approx(std::log(0.1)));
  Touch harder = some_touch();
  harder.force_vector_n *= 2;
  CHECK(radius_features(harder, 1.5F, 2, 0.1F) == features);
}

TEST_CASE("radius network: what no touch has leaves its features finite") {
  Touch weak = some_touch();
  weak.force_vector_n[0] = 0;
  for (const float odds : {-1e30F, 1e30F}) {
    for (const float feature : radius_features(weak, odds, 2, 0)) CHECK(std::abs(feature) < 100);
  }
}

TEST_CASE("radius network: answers as written out by hand, and 1 as long as it was not fitted") {
  const RadiusFeatures features = radius_features(some_touch(), 1.5F, 2, 0.1F);
  CHECK(radius_factor(TouchModelData{}.view(), features) == 1);
  const TouchModelData model = some_model();
  std::vector<double> values;
  for (std::size_t i = 0; i < features.size(); ++i) {
    const double input = double(model.radius_inputs[2 * i + 1]) * double(features[i] - model.radius_inputs[2 * i]);
    values.push_back(std::min(3.0, std::max(-3.0, input)));
  }
  for (std::size_t l = 0; l < 2; ++l) {
    values = layer_of(model.radius[l], values);
    for (double& sum : values) sum *= 0.5 * (1 + sum / std::sqrt(1 + sum * sum));
  }
  const double log_factor = layer_of(model.radius[2], values)[0];
  REQUIRE(std::abs(log_factor) < 1);
  CHECK(std::abs(log_factor) > 0.01);
  CHECK(radius_factor(model.view(), features) == doctest::Approx(std::exp(log_factor)));
}

TEST_CASE("radius network: far from all that it was fitted to it answers as at the edge, and no factor is absurd") {
  TouchModelData model = some_model();
  RadiusFeatures far = radius_features(some_touch(), 1.5F, 2, 0.1F), farther = far;
  far[0] = 1e4F;
  farther[0] = 1e6F;
  CHECK(radius_factor(model.view(), far) == radius_factor(model.view(), farther));
  model.radius[2].bias[0] = 1000;
  CHECK(radius_factor(model.view(), far) < 10);
  model.radius[2].bias[0] = -1000;
  CHECK(radius_factor(model.view(), far) > 0.1F);
}
