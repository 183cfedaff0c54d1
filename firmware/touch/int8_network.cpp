#include "firmware/touch/int8_network.h"

#include <algorithm>
#include <cstring>

namespace finsight {

namespace {

constexpr std::size_t kLanes = 16;
using Int8Lanes = std::int8_t __attribute__((vector_size(kLanes)));
using FloatLanes = float __attribute__((vector_size(kLanes * sizeof(float))));

// The compiler cuts these vectors to the width that the processor has; lane l always sums inputs l, l + 16, l + 32 ...
float dot(const std::int8_t* weights, const float* x, std::size_t count) {
  FloatLanes sums{};
  std::size_t i = 0;
  for (; i + kLanes <= count; i += kLanes) {
    Int8Lanes w;
    FloatLanes v;
    std::memcpy(&w, weights + i, sizeof w);
    std::memcpy(&v, x + i, sizeof v);
    sums += __builtin_convertvector(w, FloatLanes) * v;
  }
  for (std::size_t lane = 0; i < count; ++i, ++lane) sums[lane] += static_cast<float>(weights[i]) * x[i];
  for (std::size_t half = kLanes / 2; half > 0; half /= 2) {
    for (std::size_t lane = 0; lane < half; ++lane) sums[lane] += sums[lane + half];
  }
  return sums[0];
}

}  // namespace

void forward(const DenseInt8& layer, std::span<const float> x, std::span<float> y, bool relu) {
  const auto inputs = static_cast<std::size_t>(layer.inputs);
  for (std::size_t o = 0; o < y.size(); ++o) {
    const float sum = layer.scale[o] * dot(layer.weights.data() + o * inputs, x.data(), inputs) + layer.bias[o];
    y[o] = relu ? std::max(sum, 0.0f) : sum;
  }
}

}  // namespace finsight
