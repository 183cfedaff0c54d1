// Pictures for browsers: JPEG, and how sharp and bright they are.
#pragma once

#include <cstdint>
#include <string>

#include "firmware/published/block.h"

namespace finsight::page {

struct PictureQuality {
  double edge_px = 0;      ///< width of the sharper edges in the picture; 0: it has none
  double mean = 0;         ///< grey level, 0 ... 255
  double white_share = 0;  ///< of pixels at the upper limit
};
PictureQuality quality_of(const PublishedPicture& picture);

/// Grey JPEG (libjpeg-turbo). Throws std::runtime_error.
std::string jpeg_of(const PublishedPicture& picture);

}  // namespace finsight::page
