// The layers of the touch network: int8 weights, float activations.
#pragma once

#include "firmware/model/model.h"

namespace finsight {

/// y = scale .* (weights x) + bias, then max(y, 0) if `relu`. x: [layer.inputs], y: [layer.outputs], not overlapping.
/// Always adds in the same order (16 partial sums, then a fixed tree), so that x86-64 and ARM give the same floats.
void forward(const DenseInt8& layer, std::span<const float> x, std::span<float> y, bool relu);

}  // namespace finsight
