#include "firmware/page/picture.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

using namespace finsight;
using namespace finsight::page;

namespace {

/// Upright bars whose edges have a blur of this standard deviation.
PublishedPicture bars(double sigma_px) {
  PublishedPicture picture{.number = 1, .width_px = 640, .height_px = 480, .grey = {}};
  picture.grey.resize(640 * 480);
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 640; ++x) {
      const double to_edge = 16 - std::abs(std::fmod(x, 64.0) - 32);
      const double white = 0.5 + 0.5 * std::erf(to_edge / (sigma_px * std::numbers::sqrt2));
      picture.grey[static_cast<std::size_t>(640 * y + x)] = static_cast<std::uint8_t>(40 + 160 * white);
    }
  }
  return picture;
}

}  // namespace

TEST_CASE("picture: edges grow wider as the picture gets out of focus, and a plain picture has none") {
  const double sharp = quality_of(bars(0.7)).edge_px, soft = quality_of(bars(2)).edge_px,
               blurred = quality_of(bars(5)).edge_px;
  CHECK(sharp < 3);
  CHECK(soft > 1.5 * sharp);
  CHECK(blurred > 1.5 * soft);
  PublishedPicture plain = bars(1);
  std::ranges::fill(plain.grey, std::uint8_t{90});
  CHECK(quality_of(plain).edge_px == 0);
  CHECK(quality_of(plain).mean == 90);
  CHECK(quality_of(plain).white_share == 0);
  std::ranges::fill(plain.grey, std::uint8_t{255});
  CHECK(quality_of(plain).white_share == 1);
}

TEST_CASE("picture: it becomes a JPEG file") {
  const std::string jpeg = jpeg_of(bars(1));
  CHECK(jpeg.size() > 1000);
  CHECK(jpeg.substr(0, 3) == "\xFF\xD8\xFF");
  CHECK(jpeg.substr(jpeg.size() - 2) == "\xFF\xD9");
}
