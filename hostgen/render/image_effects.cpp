#include "hostgen/render/image_effects.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <numbers>

namespace finsight::host {

namespace {

constexpr double kReferenceWidthPx = 640;
using Block = Eigen::Matrix<float, 8, 8>;

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

/// Row k: the k-th cosine over eight pixels; its inverse is its transpose.
Block cosines() {
  Block result;
  for (int k = 0; k < 8; ++k) {
    for (int x = 0; x < 8; ++x) {
      result(k, x) =
          static_cast<float>((k == 0 ? std::sqrt(0.125) : 0.5) * std::cos((2 * x + 1) * k * std::numbers::pi / 16));
    }
  }
  return result;
}

Block rounding_steps(int quality) {
  constexpr std::array<int, 64> kLuminance = {16, 11, 10, 16, 24,  40,  51,  61,  12, 12, 14, 19, 26,  58,  60,  55,
                                              14, 13, 16, 24, 40,  57,  69,  56,  14, 17, 22, 29, 51,  87,  80,  62,
                                              18, 22, 37, 56, 68,  109, 103, 77,  24, 35, 55, 64, 81,  104, 113, 92,
                                              49, 64, 78, 87, 103, 121, 120, 101, 72, 92, 95, 98, 112, 100, 103, 99};
  const int scale = quality < 50 ? 5000 / quality : 200 - 2 * quality;
  Block steps;
  for (int i = 0; i < 64; ++i) {
    steps(i / 8, i % 8) =
        static_cast<float>(std::clamp((kLuminance[static_cast<std::size_t>(i)] * scale + 50) / 100, 1, 255));
  }
  return steps;
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

void compress_like_jpeg(std::vector<std::uint8_t>& grey, int width_px, int height_px, int quality) {
  static const Block cosine = cosines();
  const Block steps = rounding_steps(quality);
  Block block;
  for (int top = 0; top + 8 <= height_px; top += 8) {
    for (int left = 0; left + 8 <= width_px; left += 8) {
      std::uint8_t* corner = &grey[static_cast<std::size_t>(top) * width_px + left];
      for (int y = 0; y < 8; ++y) {
        for (int x = 0; x < 8; ++x) block(y, x) = static_cast<float>(corner[y * width_px + x]) - 128;
      }
      const Block coefficients = cosine * block * cosine.transpose();
      const Block rounded = (coefficients.array() / steps.array()).round() * steps.array();
      block = cosine.transpose() * rounded * cosine;
      for (int y = 0; y < 8; ++y) {
        for (int x = 0; x < 8; ++x) {
          corner[y * width_px + x] = static_cast<std::uint8_t>(std::clamp(block(y, x) + 128.5F, 0.0F, 255.0F));
        }
      }
    }
  }
}

}  // namespace finsight::host
