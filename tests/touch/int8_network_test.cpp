#include "firmware/touch/int8_network.h"

#include <doctest/doctest.h>

#include <cmath>
#include <vector>

using namespace finsight;

namespace {

struct TestLayer {
  std::vector<std::int8_t> weights;
  std::vector<float> scale, bias, x;
  int inputs, outputs;
  TestLayer(int inputs_, int outputs_) : inputs(inputs_), outputs(outputs_) {
    for (int i = 0; i < inputs * outputs; ++i) weights.push_back(std::int8_t((i * 37 + i * i * 11) % 255 - 127));
    for (int o = 0; o < outputs; ++o) {
      scale.push_back(0.01f / float(1 + o % 7));
      bias.push_back(std::sin(float(o)));
    }
    for (int i = 0; i < inputs; ++i) x.push_back(std::cos(2.3f * float(i)));
  }
  DenseInt8 view() const { return {inputs, outputs, weights, scale, bias}; }
};

}  // namespace

TEST_CASE("int8 network: a layer equals a plain reference in double, for lengths on and off the vector width") {
  for (const int inputs : {1, 15, 16, 22, 31, 48, 512}) {
    const TestLayer layer(inputs, 11);
    std::vector<float> y(11);
    for (const bool is_hidden : {false, true}) {
      forward(layer.view(), layer.x, y, is_hidden);
      int negative = 0;
      for (std::size_t o = 0; o < 11; ++o) {
        double sum = 0;
        for (std::size_t i = 0; i < std::size_t(inputs); ++i) {
          sum += double(layer.weights[o * std::size_t(inputs) + i]) * double(layer.x[i]);
        }
        double expected = double(layer.scale[o]) * sum + double(layer.bias[o]);
        negative += expected < 0;
        if (is_hidden) expected = expected / 2 * (1 + expected / std::sqrt(1 + expected * expected));
        CHECK(double(y[o]) == doctest::Approx(expected).epsilon(1e-5).scale(1));
      }
      CHECK(negative > 0);
    }
  }
}

TEST_CASE("int8 network: sums in the documented order, bit for bit") {
  const TestLayer layer(22, 3);
  std::vector<float> y(3);
  forward(layer.view(), layer.x, y, false);
  for (std::size_t o = 0; o < 3; ++o) {
    volatile float lanes[16] = {};  // volatile: no other order, no fused operation
    for (std::size_t i = 0; i < 22; ++i) {
      volatile float product = float(layer.weights[o * 22 + i]) * layer.x[i];
      lanes[i % 16] = lanes[i % 16] + product;
    }
    for (std::size_t half = 8; half > 0; half /= 2) {
      for (std::size_t l = 0; l < half; ++l) lanes[l] = lanes[l] + lanes[l + half];
    }
    volatile float scaled = layer.scale[o] * lanes[0];
    const float expected = scaled + layer.bias[o];
    CHECK(y[o] == expected);
  }
}
