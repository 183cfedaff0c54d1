// An image of grey levels that owns its pixels.
#pragma once

#include <cstdint>
#include <vector>

#include "firmware/vision/image_view.h"

namespace finsight {

struct GreyImage {
  int width_px = 0, height_px = 0;
  std::vector<std::uint8_t> grey;  ///< [height, width]
  ImageView view() const { return {grey.data(), width_px, height_px, width_px}; }
};

}  // namespace finsight
