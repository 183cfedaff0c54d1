#include "firmware/touch/int8_network.h"

#include <cstring>

namespace finsight {

namespace {

constexpr std::size_t kLanes = 16;
using Int8Lanes = std::int8_t __attribute__((vector_size(kLanes)));
using Int16Lanes = std::int16_t __attribute__((vector_size(kLanes * sizeof(std::int16_t))));
using Int32Lanes = std::int32_t __attribute__((vector_size(kLanes * sizeof(std::int32_t))));
using FloatLanes = float __attribute__((vector_size(kLanes * sizeof(float))));

/// Lane l and l + 8, then l and l + 4, and so on.
float sum_of(const FloatLanes& lanes) {
  const auto fold = [](const auto& of, auto& halves) {
    std::memcpy(&halves, &of, sizeof halves);
    return halves[0] + halves[1];
  };
  float __attribute__((vector_size(8 * sizeof(float)))) eight[2];
  float __attribute__((vector_size(4 * sizeof(float)))) four[2];
  float __attribute__((vector_size(2 * sizeof(float)))) two[2];
  float one[2];
  return fold(fold(fold(fold(lanes, eight), four), two), one);
}

FloatLanes load(const float* x) {
  FloatLanes lanes;
  std::memcpy(&lanes, x, sizeof lanes);
  return lanes;
}

FloatLanes load(const std::int8_t* weights) {
  Int8Lanes lanes;
  std::memcpy(&lanes, weights, sizeof lanes);
  // GCC converts number by number where the width changes by more than a factor of two.
  const Int32Lanes wide = __builtin_convertvector(__builtin_convertvector(lanes, Int16Lanes), Int32Lanes);
  return __builtin_convertvector(wide, FloatLanes);
}

// The compiler cuts these vectors to the width that the processor has; lane l always sums inputs l, l + 16, l + 32 ...
template <class Weight>
float dot(const Weight* weights, const float* x, std::size_t count) {
  FloatLanes sums{};
  std::size_t i = 0;
  for (; i + kLanes <= count; i += kLanes) sums += load(weights + i) * load(x + i);
  for (std::size_t lane = 0; i < count; ++i, ++lane) sums[lane] += static_cast<float>(weights[i]) * x[i];
  return sum_of(sums);
}

}  // namespace

void forward(const DenseFloat& layer, std::span<const float> x, std::span<float> y) {
  const auto inputs = static_cast<std::size_t>(layer.inputs);
  for (std::size_t o = 0; o < y.size(); ++o) {
    y[o] = dot(layer.weights.data() + o * inputs, x.data(), inputs) + layer.bias[o];
  }
}

void forward(const DenseInt8& layer, std::span<const float> x, std::span<float> y) {
  const auto inputs = static_cast<std::size_t>(layer.inputs);
  for (std::size_t o = 0; o < y.size(); ++o) {
    y[o] = layer.scale[o] * dot(layer.weights.data() + o * inputs, x.data(), inputs) + layer.bias[o];
  }
}

void activate(std::span<float> sums) {
  for (float& sum : sums) sum = algebraic_silu(sum);
}

}  // namespace finsight
