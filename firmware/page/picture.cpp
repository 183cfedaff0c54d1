#include "firmware/page/picture.h"

#include <turbojpeg.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <vector>

namespace finsight::page {

namespace {

constexpr int kJpegQuality = 80;

constexpr int kEveryRow = 8;     // enough for a meter
constexpr int kReach_px = 12;    // on either side of an edge, for its two levels
constexpr int kLeastSlope = 12;  // grey levels per pixel; less is noise
constexpr int kWhite = 250;

}  // namespace

PictureQuality quality_of(const PublishedPicture& picture) {
  PictureQuality quality;
  std::vector<double> widths;
  double sum = 0;
  std::int64_t pixels = 0, white = 0;
  for (int y = 0; y < picture.height_px; y += kEveryRow) {
    const std::uint8_t* row = picture.grey.data() + static_cast<std::ptrdiff_t>(y) * picture.width_px;
    for (int x = 0; x < picture.width_px; ++x) {
      sum += row[x];
      white += row[x] >= kWhite;
    }
    pixels += picture.width_px;
    const auto slope = [&](int x) { return std::abs(row[x + 1] - row[x - 1]) / 2; };
    for (int x = kReach_px + 2; x < picture.width_px - kReach_px - 2; ++x) {
      const int here = slope(x);
      if (here < kLeastSlope || here < slope(x - 1) || here <= slope(x + 1)) continue;
      const auto [lowest, highest] = std::minmax_element(row + x - kReach_px, row + x + kReach_px + 1);
      widths.push_back(static_cast<double>(*highest - *lowest) / here);
    }
  }
  if (pixels > 0) {
    quality.mean = sum / static_cast<double>(pixels);
    quality.white_share = static_cast<double>(white) / static_cast<double>(pixels);
  }
  if (widths.size() >= 20) {  // fewer are chance
    const auto quarter = widths.begin() + static_cast<std::ptrdiff_t>(widths.size() / 4);
    std::ranges::nth_element(widths, quarter);
    quality.edge_px = *quarter;
  }
  return quality;
}

std::string jpeg_of(const PublishedPicture& picture) {
  struct Handle {
    tjhandle handle = tjInitCompress();
    unsigned char* bytes = nullptr;
    ~Handle() {
      tjFree(bytes);
      if (handle) tjDestroy(handle);
    }
  } compressor;
  unsigned long size = 0;
  if (!compressor.handle || tjCompress2(compressor.handle, picture.grey.data(), picture.width_px, 0, picture.height_px,
                                        TJPF_GRAY, &compressor.bytes, &size, TJSAMP_GRAY, kJpegQuality, 0) != 0) {
    throw std::runtime_error("the picture cannot be compressed");
  }
  return std::string(reinterpret_cast<const char*>(compressor.bytes), size);
}

}  // namespace finsight::page
