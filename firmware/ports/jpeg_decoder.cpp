#include "firmware/ports/jpeg_decoder.h"

#include <turbojpeg.h>

#include <algorithm>
#include <cstdio>
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
  std::size_t data_at = 0;  // where the data of the scan begin
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
      header = {.width_px = static_cast<int>(word(segment, 3)),
                .height_px = static_cast<int>(word(segment, 1)),
                .bits = segment[0],
                .parts = segment[5]};
    } else if (marker > kBaseline && marker <= kLastKind && marker != kHuffmanTables) {
      return JpegOutcome::kOtherKind;
    } else if (marker == kScan) {
      if (header.parts == 0 || segment.empty()) return JpegOutcome::kBroken;
      header.data_at = at;
      const bool is_usual = header.bits == 8 && (header.parts == 1 || header.parts == 3) && segment[0] == header.parts;
      return is_usual ? JpegOutcome::kDecoded : JpegOutcome::kOtherKind;
    } else if (marker < kBaseline || marker == kStart || marker == kEnd) {
      return JpegOutcome::kBroken;
    }
  }
  return JpegOutcome::kBroken;
}

/// The zeros before the first end marker and before the 0xFFs that may precede it.
std::size_t zeros_before_end(Bytes data) {
  static constexpr std::uint8_t kEndMarker[] = {0xFF, kEnd};
  auto at = std::search(data.begin(), data.end(), std::begin(kEndMarker), std::end(kEndMarker));
  if (at == data.end()) return 0;
  while (at != data.begin() && at[-1] == 0xFF) --at;
  const auto end = at;
  while (at != data.begin() && at[-1] == 0) --at;
  return static_cast<std::size_t>(end - at);
}

/// libjpeg stopped because it skipped bytes before the end marker, and these bytes are zeros behind the data. (0xFFs
/// before a marker are part of it and no reason to stop.) It also stops so where it looks for a restart marker amid the
/// picture and finds the end, with rows not yet written.
bool stopped_at_zeros(tjhandle handle, Bytes data) {
  // It has read up to eight zeros ahead, and the data may end with a few. Where more were not skipped, they were
  // decoded in place of data that are missing: the usual tables make a block of 24 zeros.
  constexpr std::size_t kMostNotSkipped = 16;
  unsigned skipped = 0, marker = 0;
  if (tjGetErrorCode(handle) != TJERR_WARNING ||
      std::sscanf(tjGetErrorStr2(handle), "Corrupt JPEG data: %u extraneous bytes before marker 0x%x", &skipped,
                  &marker) != 2 ||
      marker != kEnd)
    return false;
  const std::size_t zeros = zeros_before_end(data);
  return skipped <= zeros && zeros - skipped <= kMostNotSkipped;
}

/// A row that no camera sees: its neighbouring pixels differ by 89 grey levels or more, and it does not repeat within
/// 256 pixels.
std::uint8_t unlikely_pixel(std::size_t x) { return static_cast<std::uint8_t>(x * 167 + 91); }

void make_unlikely(std::span<std::uint8_t> row) {
  for (std::size_t x = 0; x < row.size(); ++x) row[x] = unlikely_pixel(x);
}

bool is_unlikely(std::span<const std::uint8_t> row) {
  for (std::size_t x = 0; x < row.size(); ++x) {
    if (row[x] != unlikely_pixel(x)) return false;
  }
  return true;
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
  // libjpeg does not say how many rows it has written before it stopped. It writes them from top to bottom, so that all
  // are written once the last one has changed.
  const std::span last_row(grey + static_cast<std::ptrdiff_t>(width_px) * (height_px - 1),
                           static_cast<std::size_t>(width_px));
  make_unlikely(last_row);
  const int flags = TJFLAG_STOPONWARNING | TJFLAG_ACCURATEDCT;
  const bool done = tjDecompress2(handle_.get(), jpeg.data(), jpeg.size(), grey, width_px, width_px, height_px,
                                  TJPF_GRAY, flags) == 0;
  const bool is_whole =
      done || (stopped_at_zeros(handle_.get(), jpeg.subspan(header.data_at)) && !is_unlikely(last_row));
  return is_whole ? JpegOutcome::kDecoded : JpegOutcome::kBroken;
}

}  // namespace finsight
