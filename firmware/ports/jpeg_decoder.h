// The pictures of MJPEG cameras -> grey.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

namespace finsight {

/// What became of a picture, or why it cannot be used.
enum class JpegOutcome : std::uint8_t { kDecoded, kNotAPicture, kOtherKind, kOtherSize, kBroken };

/// Decodes what cameras send: baseline JPEG in one scan, 8 bits, grey or YUV, whose Y becomes grey levels and whose
/// colours are not computed. The time is bounded by the picture's size in pixels plus its bytes; progressive pictures,
/// whose scans a sender may repeat at will, are refused. Allocates (libjpeg-turbo does, for each picture).
class JpegDecoder {
 public:
  JpegDecoder();

  /// `grey`: width * height bytes. kDecoded: every row was decoded and written. kBroken: some rows may be written and
  /// others not, do not use any. A picture that is cut off, has bytes too many in its data or a marker where none
  /// belongs is broken. Zeros or 0xFFs before the end marker, with which some cameras fill up their buffers, are not
  /// too many, nor is anything behind it. Wrong data that happen to decode to the right number of pixels, within eight
  /// bytes, cannot be told.
  JpegOutcome decode(std::span<const std::uint8_t> jpeg, int width_px, int height_px, std::uint8_t* grey);

 private:
  struct Close {
    void operator()(void* handle) const;
  };
  std::unique_ptr<void, Close> handle_;
};

}  // namespace finsight
