// The layers of the touch network, most of int8 weights, and of the radius network; activations are floats.
#pragma once

#include <cmath>

#include "firmware/model/model.h"

namespace finsight {

// Through double, whose last-digit differences between C libraries vanish in the rounding to float.
inline float exp_float(float x) { return static_cast<float>(std::exp(static_cast<double>(x))); }
inline float log_float(float x) { return static_cast<float>(std::log(static_cast<double>(x))); }

/// What a hidden layer does to its sums: x / 2 (1 + x / sqrt(1 + x^2)), smooth as what it approximates. Of exactly
/// rounded operations only, so that every processor gives the same floats.
inline float algebraic_silu(float x) { return 0.5F * x * (1 + x / std::sqrt(1 + x * x)); }

/// y = weights x + bias. x: [layer.inputs], y: [layer.outputs], not overlapping. Always adds in the same order (16
/// partial sums, then a fixed tree), so that x86-64 and ARM give the same floats.
void forward(const DenseFloat& layer, std::span<const float> x, std::span<float> y);
/// y = scale .* (weights x) + bias, in that order, too.
void forward(const DenseInt8& layer, std::span<const float> x, std::span<float> y);

/// algebraic_silu() of every sum.
void activate(std::span<float> sums);

}  // namespace finsight
