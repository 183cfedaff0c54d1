#include "hostgen/render/image_effects.h"

#include <turbojpeg.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <functional>
#include <stdexcept>

namespace finsight::host {

namespace {

constexpr double kReferenceWidthPx = 640;

/// Calls `change(pixel, share)` for the pixels around a point, with a share that falls off like a Gaussian.
void blob(int width_px, int height_px, const Eigen::Vector2d& at_px, double sigma_px,
          const std::function<void(std::size_t, double)>& change) {
  const int reach = static_cast<int>(std::ceil(3 * sigma_px));
  const int x = static_cast<int>(at_px.x()), y = static_cast<int>(at_px.y());
  for (int row = std::max(0, y - reach); row < std::min(height_px, y + reach + 1); ++row) {
    for (int column = std::max(0, x - reach); column < std::min(width_px, x + reach + 1); ++column) {
      const double distance_sq = (Eigen::Vector2d(column, row) - at_px).squaredNorm();
      change(static_cast<std::size_t>(row) * width_px + column, std::exp(-0.5 * distance_sq / (sigma_px * sigma_px)));
    }
  }
}

}  // namespace

ImageFilm::ImageFilm(const ImageQuality& quality, int width_px, int height_px, Random& random) {
  const std::size_t pixels = static_cast<std::size_t>(width_px) * height_px;
  const double scale = width_px / kReferenceWidthPx;
  const auto anywhere = [&] { return Eigen::Vector2d(random.uniform(0, width_px), random.uniform(0, height_px)); };
  if (quality.hot_spots > 0) glare.assign(pixels, 0);
  for (int spot = 0; spot < quality.hot_spots; ++spot) {
    const double level = random.uniform(60, 160), sigma_px = scale * random.uniform(6, 20);
    blob(width_px, height_px, anywhere(), sigma_px,
         [&](std::size_t pixel, double share) { glare[pixel] += static_cast<float>(level * share); });
  }
  if (quality.dirt > 0 || quality.beams > 0) transmission.assign(pixels, 1);
  for (int speck = 0; speck < quality.dirt; ++speck) {
    const double dark = random.uniform(0.2, 0.6), sigma_px = scale * random.uniform(1.5, 6);
    blob(width_px, height_px, anywhere(), sigma_px,
         [&](std::size_t pixel, double share) { transmission[pixel] *= static_cast<float>(1 - dark * share); });
  }
  for (int beam = 0; beam < quality.beams; ++beam) {  // from the left and the right side in turn
    constexpr float kDark = 0.15F;
    const int first_y = static_cast<int>(random.uniform(0.1, 0.9) * height_px);
    const int last_y = std::min(height_px, first_y + static_cast<int>(scale * random.uniform(8, 16)));
    const int reach = static_cast<int>(random.uniform(0.15, 0.35) * width_px);
    const int first_x = beam % 2 == 0 ? 0 : width_px - reach;
    for (int y = first_y; y < last_y; ++y) {
      for (int x = first_x; x < first_x + reach; ++x) transmission[static_cast<std::size_t>(y) * width_px + x] *= kDark;
    }
  }
}

void through_jpeg(std::vector<std::uint8_t>& grey, int width_px, int height_px, int quality) {
  struct Handles {
    tjhandle compressor = tjInitCompress(), decompressor = tjInitDecompress();
    unsigned char* bytes = nullptr;
    ~Handles() {
      tjFree(bytes);
      if (compressor) tjDestroy(compressor);
      if (decompressor) tjDestroy(decompressor);
    }
  } jpeg;
  unsigned long size = 0;
  if (!jpeg.compressor || !jpeg.decompressor ||
      tjCompress2(jpeg.compressor, grey.data(), width_px, 0, height_px, TJPF_GRAY, &jpeg.bytes, &size, TJSAMP_GRAY,
                  quality, TJFLAG_ACCURATEDCT) != 0 ||
      tjDecompress2(jpeg.decompressor, jpeg.bytes, size, grey.data(), width_px, 0, height_px, TJPF_GRAY,
                    TJFLAG_ACCURATEDCT) != 0) {
    throw std::runtime_error("libjpeg-turbo cannot compress a picture");
  }
}

}  // namespace finsight::host
