// A borrowed grey image or a window of one.
#pragma once

#include <cstddef>
#include <cstdint>

#include "firmware/types.h"

namespace finsight {

/// 8 bit grey levels, row by row; pixel (x, y) is `pixels[y * stride_bytes + x]` and its centre lies at (x, y).
struct ImageView {
  const std::uint8_t* pixels = nullptr;
  int width_px = 0, height_px = 0, stride_bytes = 0;
  Coding coding = Coding::kLinear;

  const std::uint8_t* at(int x, int y) const { return pixels + static_cast<std::ptrdiff_t>(y) * stride_bytes + x; }

  /// Bilinear grey level; the caller keeps 0 <= x < width - 1 and 0 <= y < height - 1.
  float sample(float x, float y) const {
    const int column = static_cast<int>(x), row = static_cast<int>(y);
    const float u = x - static_cast<float>(column), v = y - static_cast<float>(row);
    const std::uint8_t* top = at(column, row);
    const std::uint8_t* bottom = top + stride_bytes;
    const float above = static_cast<float>(top[0]) * (1 - u) + static_cast<float>(top[1]) * u;
    const float below = static_cast<float>(bottom[0]) * (1 - u) + static_cast<float>(bottom[1]) * u;
    return above * (1 - v) + below * v;
  }
};

}  // namespace finsight
