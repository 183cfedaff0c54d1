#include "firmware/touch/features.h"

#include <cmath>

namespace finsight {

void touch_features(const TouchModel& model, const PoseVector& motion, const std::array<float, kPlates>& noise,
                    float unknown_g, std::span<float, TouchModel::kInputs> inputs) {
  // In double and in a fixed order: the result, rounded to float, is then the same on every processor.
  double size_sq = 0;
  for (std::size_t i = 0; i < kPoseDims; ++i) {
    inputs[i] = model.scale[i] * motion[static_cast<int>(i)];
    size_sq += static_cast<double>(inputs[i]) * static_cast<double>(inputs[i]);
  }
  const double size = std::sqrt(size_sq) + static_cast<double>(kSmallestMotion);
  for (std::size_t i = 0; i < kPoseDims; ++i) inputs[i] = static_cast<float>(static_cast<double>(inputs[i]) / size);
  inputs[kPoseDims] = static_cast<float>(std::log(size));
  for (std::size_t p = 0; p < kPlates; ++p) inputs[kPoseDims + 1 + p] = log_float(noise[p]);
  inputs[kPoseDims + 1 + kPlates] = log_unknown_g(unknown_g);
  for (std::size_t i = 0; i < TouchModel::kInputs; ++i) {
    inputs[i] = (inputs[i] - model.input_mean[i]) * model.input_scale[i];
  }
}

}  // namespace finsight
