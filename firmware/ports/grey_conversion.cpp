#include "firmware/ports/grey_conversion.h"

#include <algorithm>
#include <cstddef>

namespace finsight {

namespace {

// Luma of BT.601 in 256ths: what cameras' own Y means.
constexpr std::uint16_t kRed = 77, kGreen = 150, kBlue = 29;

struct Format {
  std::uint32_t code;
  std::uint64_t modifier;
  GreyLayout layout;
};

// What a sensor gives is kept best by its own grey levels; YUV and RGB have been sharpened and smoothed for the eye,
// and JPEG rounds, besides.
enum Rank { kRawPlane, kRawBits, kYuvPlane, kYuvPacked, kRgb, kJpeg };

constexpr Format raw_plane(const char (&code)[5], const char (&v4l2)[5]) {
  return {four_characters(code), 0, {.rank = kRawPlane, .v4l2 = four_characters(v4l2)}};
}
/// 16 bits per pixel, the low byte first, of which the lowest `bits` are used.
constexpr Format raw_words(const char (&code)[5], int bits, const char (&v4l2)[5]) {
  const auto low = static_cast<std::uint16_t>(256 >> (bits - 8)),
             high = static_cast<std::uint16_t>(65536 >> (bits - 8));
  return {four_characters(code),
          0,
          {.step_bytes = 2,
           .offset = {0, 1, 0},
           .weight = {low, high, 0},
           .rank = kRawBits,
           .v4l2 = four_characters(v4l2)}};
}
/// The upper 8 bits of each pixel of a group, then a byte with the lower bits of all.
constexpr Format raw_packed(const char (&code)[5], int group, const char (&v4l2)[5]) {
  return {four_characters(code),
          kMipiPacked,
          {.group = group, .step_bytes = group + 1, .rank = kRawBits, .v4l2 = four_characters(v4l2)}};
}
constexpr Format yuv_plane(const char (&code)[5]) {
  return {four_characters(code), 0, {.rank = kYuvPlane, .v4l2 = four_characters(code)}};
}
constexpr Format packed_yuv(const char (&code)[5], std::uint8_t y) {
  return {four_characters(code),
          0,
          {.step_bytes = 2, .offset = {y, y, y}, .rank = kYuvPacked, .v4l2 = four_characters(code)}};
}
constexpr Format rgb(const char (&code)[5], int step_bytes, std::array<std::uint8_t, 3> red_green_blue,
                     const char (&v4l2)[5]) {
  return {four_characters(code),
          0,
          {.step_bytes = step_bytes,
           .offset = red_green_blue,
           .weight = {kRed, kGreen, kBlue},
           .rank = kRgb,
           .v4l2 = four_characters(v4l2)}};
}
constexpr Format jpeg(const char (&code)[5]) {
  return {four_characters(code), 0, {.is_jpeg = true, .rank = kJpeg, .v4l2 = four_characters(code)}};
}

// An RGB format's code names its bytes from the highest down: R24 ("RGB888") is B, G, R in memory.
constexpr Format kFormats[] = {
    raw_plane("R8  ", "GREY"),
    raw_words("R10 ", 10, "Y10 "),
    raw_words("R12 ", 12, "Y12 "),
    raw_words("R16 ", 16, "Y16 "),
    raw_packed("R10 ", 4, "Y10P"),
    raw_packed("R12 ", 2, "Y12P"),
    yuv_plane("YU12"),
    yuv_plane("YV12"),
    yuv_plane("NV12"),
    yuv_plane("NV21"),
    yuv_plane("NV16"),
    yuv_plane("NV61"),
    yuv_plane("YU16"),
    yuv_plane("YV16"),
    yuv_plane("NV24"),
    yuv_plane("NV42"),
    yuv_plane("YU24"),
    yuv_plane("YV24"),
    packed_yuv("YUYV", 0),
    packed_yuv("YVYU", 0),
    packed_yuv("UYVY", 1),
    packed_yuv("VYUY", 1),
    rgb("RG24", 3, {2, 1, 0}, "BGR3"),
    rgb("BG24", 3, {0, 1, 2}, "RGB3"),
    rgb("XR24", 4, {2, 1, 0}, "XR24"),
    rgb("XB24", 4, {0, 1, 2}, "XB24"),
    jpeg("MJPG"),
};

}  // namespace

std::optional<GreyLayout> grey_layout(std::uint32_t fourcc, std::uint64_t modifier) {
  for (const Format& format : kFormats) {
    if (format.code == fourcc && format.modifier == modifier) return format.layout;
  }
  return std::nullopt;
}

void convert_to_grey(const GreyLayout& layout, const std::uint8_t* pixels, int width_px, int height_px,
                     int stride_bytes, std::uint8_t* grey) {
  const unsigned w0 = layout.weight[0], w1 = layout.weight[1], w2 = layout.weight[2];
  for (int y = 0; y < height_px; ++y) {
    const std::uint8_t* from = pixels + static_cast<std::ptrdiff_t>(y) * stride_bytes;
    for (int x = 0; x < width_px; x += layout.group, from += layout.step_bytes) {
      for (int i = 0; i < std::min(layout.group, width_px - x); ++i) {
        const unsigned sum =
            w0 * from[i + layout.offset[0]] + w1 * from[i + layout.offset[1]] + w2 * from[i + layout.offset[2]];
        *grey++ = static_cast<std::uint8_t>(std::min(sum >> 8, 255U));
      }
    }
  }
}

}  // namespace finsight
