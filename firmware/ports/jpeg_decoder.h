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

  /// `grey`: width * height bytes, which a broken picture may have changed. A picture that is cut off, has a byte too
  /// many in its data or a marker where none belongs is broken. Bytes behind the data are not: many cameras fill up
  /// their buffers, some before the end marker.
  JpegOutcome decode(std::span<const std::uint8_t> jpeg, int width_px, int height_px, std::uint8_t* grey);

 private:
  struct Close {
    void operator()(void* handle) const;
  };
  std::unique_ptr<void, Close> handle_;
};

}  // namespace finsight
