#include "firmware/ports/jpeg_decoder.h"

#include <turbojpeg.h>

#include <cstring>
#include <new>

namespace finsight {

namespace {

using Bytes = std::span<const std::uint8_t>;

enum Marker : std::uint8_t {
  kBaseline = 0xC0,
  kHuffmanTables = 0xC4,
  kLastKind = 0xCF,  // with kBaseline the first: progressive, lossless, arithmetic and so on
  kStart = 0xD8,
  kEnd = 0xD9,
  kScan = 0xDA
};

struct Header {
  int width_px = 0, height_px = 0, bits = 0, parts = 0;
};

unsigned word(Bytes bytes, std::size_t at) { return static_cast<unsigned>(bytes[at] << 8 | bytes[at + 1]); }

/// Walks over the segments before the picture's data. kDecoded: a baseline picture whose one scan holds all of it.
JpegOutcome read_header(Bytes jpeg, Header& header) {
  if (jpeg.size() < 4 || jpeg[0] != 0xFF || jpeg[1] != kStart) return JpegOutcome::kNotAPicture;
  for (std::size_t at = 2; at + 4 <= jpeg.size();) {
    if (jpeg[at] != 0xFF) return JpegOutcome::kBroken;
    const std::uint8_t marker = jpeg[at + 1];
    if (marker == 0xFF) {  // a filler
      ++at;
      continue;
    }
    const std::size_t length = word(jpeg, at + 2);
    if (length < 2 || at + 2 + length > jpeg.size()) return JpegOutcome::kBroken;
    const Bytes segment = jpeg.subspan(at + 4, length - 2);
    at += 2 + length;
    if (marker == kBaseline) {
      if (segment.size() < 6 || header.parts != 0) return JpegOutcome::kBroken;
      header = {static_cast<int>(word(segment, 3)), static_cast<int>(word(segment, 1)), segment[0], segment[5]};
    } else if (marker > kBaseline && marker <= kLastKind && marker != kHuffmanTables) {
      return JpegOutcome::kOtherKind;
    } else if (marker == kScan) {
      if (header.parts == 0 || segment.empty()) return JpegOutcome::kBroken;
      const bool is_usual = header.bits == 8 && (header.parts == 1 || header.parts == 3) && segment[0] == header.parts;
      return is_usual ? JpegOutcome::kDecoded : JpegOutcome::kOtherKind;
    } else if (marker < kBaseline || marker == kStart || marker == kEnd) {
      return JpegOutcome::kBroken;
    }
  }
  return JpegOutcome::kBroken;
}

/// The picture's data ended as they should, and more bytes came before the end marker. All rows have been decoded by
/// then, because there is only one scan.
bool only_fills_up(tjhandle handle) {
  return tjGetErrorCode(handle) == TJERR_WARNING &&
         std::strstr(tjGetErrorStr2(handle), "extraneous bytes before marker 0xd9") != nullptr;
}

}  // namespace

void JpegDecoder::Close::operator()(void* handle) const { tjDestroy(handle); }

JpegDecoder::JpegDecoder() : handle_(tjInitDecompress()) {
  if (!handle_) throw std::bad_alloc();
}

JpegOutcome JpegDecoder::decode(Bytes jpeg, int width_px, int height_px, std::uint8_t* grey) {
  Header header;
  const JpegOutcome outcome = read_header(jpeg, header);
  if (outcome != JpegOutcome::kDecoded) return outcome;
  if (header.width_px != width_px || header.height_px != height_px) return JpegOutcome::kOtherSize;
  const int flags = TJFLAG_STOPONWARNING | TJFLAG_ACCURATEDCT;
  const bool done = tjDecompress2(handle_.get(), jpeg.data(), jpeg.size(), grey, width_px, width_px, height_px,
                                  TJPF_GRAY, flags) == 0;
  return done || only_fills_up(handle_.get()) ? JpegOutcome::kDecoded : JpegOutcome::kBroken;
}

}  // namespace finsight
