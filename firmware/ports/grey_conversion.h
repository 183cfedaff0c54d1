// Cameras' pixel formats -> 8 bit grey: which formats can be used, and how.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

namespace finsight {

/// Four-character code, its first character in the lowest byte, as Linux' drm_fourcc.h and videodev2.h have them.
constexpr std::uint32_t four_characters(const char (&code)[5]) {
  std::uint32_t value = 0;
  for (int i = 4; i-- > 0;) value = value << 8 | static_cast<std::uint8_t>(code[i]);
  return value;
}

/// drm_fourcc.h's modifier of formats that are packed as MIPI CSI-2 sends them.
inline constexpr std::uint64_t kMipiPacked = std::uint64_t{11} << 56 | 1;

/// Where the grey levels are in a row of the first plane. Pixels come in groups of `group` in `step_bytes`; the i-th
/// pixel of a group is the sum of weight[k] * byte[i + offset[k]] / 256, the bytes counted from the group's start.
struct GreyLayout {
  int group = 1, step_bytes = 1;
  std::array<std::uint8_t, 3> offset{};
  std::array<std::uint16_t, 3> weight{256, 0, 0};
  bool is_jpeg = false;    ///< each picture is a JPEG file; the rest means nothing
  int rank = 0;            ///< the smaller, the more of the sensor's picture is kept and the cheaper the conversion
  std::uint32_t v4l2 = 0;  ///< the same format's code in videodev2.h; 0: it has none

  /// The plane is the grey image already.
  bool is_grey_plane() const { return step_bytes == 1 && !is_jpeg; }
};

/// The layout of a format, by its code and modifier (Linux' drm_fourcc.h); nothing for one that would have to be
/// demosaicked. Of more than 8 bits the upper 8 are used.
std::optional<GreyLayout> grey_layout(std::uint32_t fourcc, std::uint64_t modifier = 0);

/// Converts one image, which is no JPEG file; `grey` has width * height bytes.
void convert_to_grey(const GreyLayout& layout, const std::uint8_t* pixels, int width_px, int height_px,
                     int stride_bytes, std::uint8_t* grey);

}  // namespace finsight
