#include "firmware/ports/grey_conversion.h"

#include <cstddef>
#include <string_view>

namespace finsight {

namespace {

// Luma of BT.601 in 256ths: what cameras' own Y means.
constexpr std::uint16_t kRed = 77, kGreen = 150, kBlue = 29;

struct Format {
  std::string_view code;
  GreyLayout layout;
};

constexpr GreyLayout kPlane{.rank = 0};
constexpr GreyLayout packed_yuv(std::uint8_t y) { return {.step_bytes = 2, .offset = {y}, .rank = 1}; }
constexpr GreyLayout rgb(int step_bytes, std::uint8_t red, std::uint8_t green, std::uint8_t blue) {
  return {.step_bytes = step_bytes, .offset = {red, green, blue}, .weight = {kRed, kGreen, kBlue}, .rank = 2};
}

// A format's code names its bytes from the highest down: R24 ("RGB888") is B, G, R in memory.
constexpr Format kFormats[] = {
    {"R8  ", kPlane},          {"YU12", kPlane},          {"YV12", kPlane},          {"NV12", kPlane},
    {"NV21", kPlane},          {"NV16", kPlane},          {"NV61", kPlane},          {"YU16", kPlane},
    {"YV16", kPlane},          {"NV24", kPlane},          {"NV42", kPlane},          {"YU24", kPlane},
    {"YV24", kPlane},          {"YUYV", packed_yuv(0)},   {"YVYU", packed_yuv(0)},   {"UYVY", packed_yuv(1)},
    {"VYUY", packed_yuv(1)},   {"RG24", rgb(3, 2, 1, 0)}, {"BG24", rgb(3, 0, 1, 2)}, {"XR24", rgb(4, 2, 1, 0)},
    {"XB24", rgb(4, 0, 1, 2)},
};

constexpr std::uint32_t fourcc_of(std::string_view code) {
  std::uint32_t value = 0;
  for (std::size_t i = 4; i-- > 0;) value = value << 8 | static_cast<std::uint8_t>(code[i]);
  return value;
}

}  // namespace

std::optional<GreyLayout> grey_layout(std::uint32_t fourcc) {
  for (const Format& format : kFormats) {
    if (fourcc_of(format.code) == fourcc) return format.layout;
  }
  return std::nullopt;
}

void convert_to_grey(const GreyLayout& layout, const std::uint8_t* pixels, int width_px, int height_px,
                     int stride_bytes, std::uint8_t* grey) {
  const auto [w0, w1, w2] = layout.weight;
  for (int y = 0; y < height_px; ++y) {
    const std::uint8_t* from = pixels + static_cast<std::ptrdiff_t>(y) * stride_bytes;
    for (int x = 0; x < width_px; ++x, from += layout.step_bytes) {
      const unsigned sum = w0 * from[layout.offset[0]] + w1 * from[layout.offset[1]] + w2 * from[layout.offset[2]];
      *grey++ = static_cast<std::uint8_t>(sum >> 8);
    }
  }
}

}  // namespace finsight
