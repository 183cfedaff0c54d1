// What an image says about the camera: that it gives the same one again and again, hardly any light or too much, or
// nothing sharp.
#pragma once

#include <array>
#include <cstdint>

#include "firmware/types.h"
#include "firmware/vision/image_view.h"

namespace finsight {

class ImageCheck {
 public:
  /// To be called with every image. Frozen from the fifth in a row on that equals one of the four before it (a stuck
  /// driver hands out its buffers in turn): a sensor's noise never repeats, though a light switched on during
  /// readout may repeat one or two. Dark and bright: the mean grey level is below 6 or above 249. Blurred from the 30th
  /// blurred image in a row on, so that fast moves do not count: no edge in them is sharper than a blur with a standard
  /// deviation of 1/280 of the image's width (4.5 pixels of 1280), though there is contrast. Looks at every eighth row:
  /// 100 us for 1280 x 720. Never allocates.
  ImageFault check(const ImageView& image);
  /// Whether the last image equals one of the four before it: it says nothing about the present.
  bool repeats() const { return repeats_ > 0; }

 private:
  bool is_blurred(const ImageView& image) const;

  std::array<std::uint64_t, 4> last_checksums_{};
  std::size_t next_ = 0;
  int repeats_ = 0, blurred_ = 0;
};

}  // namespace finsight
