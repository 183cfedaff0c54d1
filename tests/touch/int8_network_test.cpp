#include "firmware/touch/int8_network.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <vector>

using namespace finsight;

namespace {

struct TestLayer {
  std::vector<std::int8_t> weights;
  std::vector<float> float_weights, scale, bias, x;
  int inputs, outputs;
  TestLayer(int inputs_, int outputs_) : inputs(inputs_), outputs(outputs_) {
    for (int i = 0; i < inputs * outputs; ++i) {
      weights.push_back(std::int8_t((i * 37 + i * i * 11) % 255 - 127));
      float_weights.push_back(float(weights.back()) / 300);
    }
    for (int o = 0; o < outputs; ++o) {
      scale.push_back(0.01f / float(1 + o % 7));
      bias.push_back(std::sin(float(o)));
    }
    for (int i = 0; i < inputs; ++i) x.push_back(std::cos(2.3f * float(i)));
  }
  DenseInt8 rounded() const { return {inputs, outputs, weights, scale, bias}; }
  DenseFloat as_trained() const { return {inputs, outputs, float_weights, bias}; }
  /// In double, of the one or the other.
  double sum(std::size_t output, bool is_rounded) const {
    double sum = 0;
    for (std::size_t i = 0; i < std::size_t(inputs); ++i) {
      const std::size_t at = output * std::size_t(inputs) + i;
      sum += double(is_rounded ? float(weights[at]) : float_weights[at]) * double(x[i]);
    }
    return (is_rounded ? double(scale[output]) : 1) * sum + double(bias[output]);
  }
};

/// The sum of the products of one output, in the documented order.
template <class Weight>
float ordered_sum(const std::vector<Weight>& weights, const std::vector<float>& x, std::size_t output) {
  volatile float lanes[16] = {};  // volatile: no other order, no fused operation
  for (std::size_t i = 0; i < x.size(); ++i) {
    volatile float product = float(weights[output * x.size() + i]) * x[i];
    lanes[i % 16] = lanes[i % 16] + product;
  }
  for (std::size_t half = 8; half > 0; half /= 2) {
    for (std::size_t l = 0; l < half; ++l) lanes[l] = lanes[l] + lanes[l + half];
  }
  return lanes[0];
}

}  // namespace

TEST_CASE("int8 network: a layer and its activation equal a plain reference, for lengths on and off the vector width") {
  for (const int inputs : {1, 15, 16, 22, 31, 48, 512}) {
    const TestLayer layer(inputs, 11);
    std::vector<float> y(11);
    for (const bool is_rounded : {false, true}) {
      const auto check = [&](const auto& of_sum) {
        for (std::size_t o = 0; o < 11; ++o) {
          CHECK(double(y[o]) == doctest::Approx(of_sum(layer.sum(o, is_rounded))).epsilon(1e-5).scale(1));
        }
      };
      is_rounded ? forward(layer.rounded(), layer.x, y) : forward(layer.as_trained(), layer.x, y);
      check([](double sum) { return sum; });
      const auto negative = std::ranges::count_if(y, [](float sum) { return sum < 0; });
      CHECK(negative > 0);
      CHECK(negative < 11);
      activate(y);
      check([](double sum) { return sum / 2 * (1 + sum / std::sqrt(1 + sum * sum)); });
    }
  }
}

TEST_CASE("int8 network: sums in the documented order, bit for bit") {
  const TestLayer layer(22, 3);
  std::vector<float> y(3);
  forward(layer.rounded(), layer.x, y);
  for (std::size_t o = 0; o < 3; ++o) {
    volatile float scaled = layer.scale[o] * ordered_sum(layer.weights, layer.x, o);
    CHECK(y[o] == scaled + layer.bias[o]);
  }
  forward(layer.as_trained(), layer.x, y);
  for (std::size_t o = 0; o < 3; ++o) CHECK(y[o] == ordered_sum(layer.float_weights, layer.x, o) + layer.bias[o]);
}
