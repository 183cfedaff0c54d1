#include "firmware/vision/image_check.h"

#include <algorithm>
#include <cstdlib>
#include <cstring>

namespace finsight {

namespace {

constexpr int kRowStep = 8;
constexpr int kMaxRepeats = 5;
constexpr double kDarkest = 6, kBrightest = 249;
constexpr int kSharpRowStep = 32;    // a marker's edges are longer
constexpr int kBlocksPerRow = 320;   // blocks of pixels that are averaged against noise
constexpr int kMinContrast = 50;     // grey levels between blocks; with less there is nothing to be sharp
constexpr double kSharpShare = 0.6;  // of the contrast, between a block and the next but one
constexpr int kMaxBlurred = 30;

}  // namespace

// One pass over the rows: their sum, and a checksum that changes with any of its words and with their order. An image
// that repeats is frozen, however dark it is; but a sensor that sees nothing at all may well give the same again.
ImageFault ImageCheck::check(const ImageView& image) {
  if (!image.pixels || image.width_px < 1 || image.height_px < 1 || image.stride_bytes < image.width_px) {
    return ImageFault::kNone;
  }
  std::uint64_t checksum = 0xcbf29ce484222325, sum = 0, pixels = 0, differing = 0;
  const std::uint64_t plain = std::uint64_t{0x0101010101010101} * *image.at(0, 0);
  const int words = image.width_px / 8;
  for (int y = 0; y < image.height_px; y += kRowStep) {
    const std::uint8_t* row = image.at(0, y);
    for (int k = 0; k < words; ++k) {
      std::uint64_t word;
      std::memcpy(&word, row + 8 * k, sizeof word);
      differing |= word ^ plain;
      checksum = (checksum ^ word) * 0x9e3779b97f4a7c15;
      checksum ^= checksum >> 29;
    }
    for (int x = 0; x < image.width_px; ++x) sum += row[x];
    pixels += static_cast<std::uint64_t>(image.width_px);
  }
  const bool repeated = std::find(last_checksums_.begin(), last_checksums_.end(), checksum) != last_checksums_.end();
  repeats_ = repeated ? repeats_ + 1 : 0;
  last_checksums_[next_++ % last_checksums_.size()] = checksum;
  const double mean = static_cast<double>(sum) / static_cast<double>(pixels);
  if (repeats_ >= kMaxRepeats && differing != 0) return ImageFault::kFrozen;
  if (mean < kDarkest) return ImageFault::kDark;
  if (mean > kBrightest) return ImageFault::kBright;
  if (repeats_ >= kMaxRepeats) return ImageFault::kFrozen;
  blurred_ = is_blurred(image) ? std::min(blurred_ + 1, kMaxBlurred) : 0;
  return blurred_ >= kMaxBlurred ? ImageFault::kBlurred : ImageFault::kNone;
}

// Across a sharp edge the grey level goes all the way from one block to the next but one; a blur spreads it over more.
bool ImageCheck::is_blurred(const ImageView& image) const {
  const int width = std::max(1, image.width_px / kBlocksPerRow);
  int darkest = 255 * width, brightest = 0, steepest = 0;
  for (int y = 0; y < image.height_px; y += kSharpRowStep) {
    const std::uint8_t* row = image.at(0, y);
    int before = 0, last = 0;
    for (int k = 0; (k + 1) * width <= image.width_px; ++k) {
      int sum = 0;
      for (int x = k * width; x < (k + 1) * width; ++x) sum += row[x];
      darkest = std::min(darkest, sum);
      brightest = std::max(brightest, sum);
      if (k >= 2) steepest = std::max(steepest, std::abs(sum - before));
      before = last;
      last = sum;
    }
  }
  const int contrast = brightest - darkest;
  return contrast > kMinContrast * width && steepest < kSharpShare * contrast;
}

}  // namespace finsight
