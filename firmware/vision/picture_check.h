// What a picture says about the camera: that it gives the same one again and again, or hardly any light or too much.
#pragma once

#include <cstdint>

#include "firmware/vision/grey_view.h"

namespace finsight {

enum class PictureFault : std::uint8_t { kNone, kFrozen, kDark, kBright };

class PictureCheck {
 public:
  /// To be called with every picture. Frozen from the sixth equal one in a row on: a sensor's noise never repeats,
  /// while a stuck driver or a light that went on during readout may repeat one or two. Dark and bright: the mean grey
  /// level is below 6 or above 249. Looks at every eighth row: 40 us for 1280 x 720. Never allocates.
  PictureFault look(const GreyView& picture);

 private:
  std::uint64_t last_checksum_ = 0;
  int repeats_ = 0;
};

}  // namespace finsight
