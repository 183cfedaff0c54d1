#include "firmware/vision/picture_check.h"

#include <cstring>

namespace finsight {

namespace {

constexpr int kRowStep = 8;
constexpr int kMostRepeats = 5;
constexpr double kDarkest = 6, kBrightest = 249;

}  // namespace

// One pass over the rows: their sum, and a checksum that changes with any byte and with the bytes' order.
PictureFault PictureCheck::look(const GreyView& picture) {
  if (!picture.pixels || picture.width_px < 1 || picture.height_px < 1 || picture.stride_bytes < picture.width_px) {
    return PictureFault::kNone;
  }
  std::uint64_t checksum = 0xcbf29ce484222325, sum = 0, pixels = 0;
  const int words = picture.width_px / 8;
  for (int y = 0; y < picture.height_px; y += kRowStep) {
    const std::uint8_t* row = picture.at(0, y);
    for (int k = 0; k < words; ++k) {
      std::uint64_t word;
      std::memcpy(&word, row + 8 * k, sizeof word);
      checksum = (checksum ^ word) * 0x9e3779b97f4a7c15;
      checksum ^= checksum >> 29;
    }
    for (int x = 0; x < picture.width_px; ++x) sum += row[x];
    pixels += static_cast<std::uint64_t>(picture.width_px);
  }
  repeats_ = checksum == last_checksum_ ? repeats_ + 1 : 0;
  last_checksum_ = checksum;
  const double mean = static_cast<double>(sum) / static_cast<double>(pixels);
  if (mean < kDarkest) return PictureFault::kDark;
  if (mean > kBrightest) return PictureFault::kBright;
  return repeats_ >= kMostRepeats ? PictureFault::kFrozen : PictureFault::kNone;
}

}  // namespace finsight
