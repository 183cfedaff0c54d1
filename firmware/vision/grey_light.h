// Grey levels -> light.
#pragma once

#include <array>
#include <cmath>

#include "firmware/types.h"

namespace finsight {

/// Light (0 ... 255) that a grey level (0 ... 255) stands for.
inline float light_of(float grey, Coding coding) {
  if (coding == Coding::kLinear) return grey;
  static const std::array<float, 257> kLight = [] {
    std::array<float, 257> light{};
    for (std::size_t i = 0; i < light.size(); ++i) {
      const double coded = static_cast<double>(i) / 255;
      const double linear = coded <= 0.04045 ? coded / 12.92 : std::pow((coded + 0.055) / 1.055, 2.4);
      light[i] = static_cast<float>(255 * linear);
    }
    return light;
  }();
  const auto below = static_cast<std::size_t>(grey);
  const float share = grey - static_cast<float>(below);
  return kLight[below] * (1 - share) + kLight[below + 1] * share;
}

}  // namespace finsight
