// Cameras' pixel formats -> 8 bit grey: which formats can be used, and how.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

namespace finsight {

/// Where the grey levels are in a row of the first plane: grey = sum of weight[k] * byte[pixel * step_bytes +
/// offset[k]] / 256.
struct GreyLayout {
  int step_bytes = 1;
  std::array<std::uint8_t, 3> offset{};
  std::array<std::uint16_t, 3> weight{256, 0, 0};
  int rank = 0;  ///< the smaller, the cheaper the conversion

  /// The plane is the grey image already.
  bool is_grey_plane() const { return step_bytes == 1; }
};

/// The layout of a format, by its four-character code (Linux' drm_fourcc.h); nothing for one that would have to be
/// decoded (MJPEG) or demosaicked.
std::optional<GreyLayout> grey_layout(std::uint32_t fourcc);

/// Converts one image; `grey` has width * height bytes.
void convert_to_grey(const GreyLayout& layout, const std::uint8_t* pixels, int width_px, int height_px,
                     int stride_bytes, std::uint8_t* grey);

}  // namespace finsight
