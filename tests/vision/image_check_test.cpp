#include "firmware/vision/image_check.h"

#include <doctest/doctest.h>

#include <cmath>
#include <vector>

#include "tests/random.h"

using namespace finsight;

namespace {

constexpr int kWidth = 100, kHeight = 50;  // not whole words

struct Image {
  explicit Image(int level, std::uint64_t seed = 0) : grey(kWidth * kHeight) {
    test::Random random(seed);
    for (std::uint8_t& pixel : grey) pixel = static_cast<std::uint8_t>(seed ? level + random.uniform() * 4 : level);
  }
  ImageView view() const { return {grey.data(), kWidth, kHeight, kWidth}; }
  std::vector<std::uint8_t> grey;
};

}  // namespace

TEST_CASE("image check: noise is never taken for a frozen camera") {
  ImageCheck check;
  for (std::uint64_t frame = 1; frame < 100; ++frame) CHECK(check.check(Image(100, frame).view()) == ImageFault::kNone);
}

TEST_CASE("image check: the sixth equal image is a frozen camera, and a new image ends it") {
  ImageCheck check;
  const Image same(100, 1);
  for (int frame = 0; frame < 5; ++frame) CHECK(check.check(same.view()) == ImageFault::kNone);
  CHECK(check.check(same.view()) == ImageFault::kFrozen);
  CHECK(check.check(same.view()) == ImageFault::kFrozen);
  CHECK(check.check(Image(100, 2).view()) == ImageFault::kNone);
  CHECK(check.check(same.view()) == ImageFault::kNone);
}

TEST_CASE("image check: an image that differs in one pixel is a new one") {
  ImageCheck check;
  Image one(100, 1);
  for (int frame = 0; frame < 20; ++frame) {
    one.grey[8 * kWidth + 33] = static_cast<std::uint8_t>(frame);
    CHECK(check.check(one.view()) == ImageFault::kNone);
  }
}

TEST_CASE("image check: up to four images in turn are a frozen camera, five are not") {
  for (int ring = 2; ring <= 5; ++ring) {
    ImageCheck check;
    for (int frame = 0; frame < 40; ++frame) {
      const ImageFault fault = check.check(Image(100, 1 + static_cast<std::uint64_t>(frame % ring)).view());
      CHECK((fault == ImageFault::kFrozen) == (ring <= 4 && frame >= ring + 4));
    }
  }
}

TEST_CASE("image check: a dark image that repeats is a frozen camera, however little it shows") {
  ImageCheck check;
  Image dark(1);
  dark.grey[8 * kWidth + 40] = 200;  // a lit marker on black
  for (int frame = 0; frame < 5; ++frame) CHECK(check.check(dark.view()) == ImageFault::kDark);
  CHECK(check.check(dark.view()) == ImageFault::kFrozen);
}

TEST_CASE("image check: uniformly dark and bright images are reported as such, frozen or not") {
  ImageCheck check;
  for (int frame = 0; frame < 8; ++frame) CHECK(check.check(Image(2).view()) == ImageFault::kDark);
  for (int frame = 0; frame < 8; ++frame) CHECK(check.check(Image(255).view()) == ImageFault::kBright);
  CHECK(check.check(Image(10, 1).view()) == ImageFault::kNone);
  CHECK(check.check(Image(240, 1).view()) == ImageFault::kNone);
}

TEST_CASE("image check: a missing image is not an image fault") {
  CHECK(ImageCheck().check({}) == ImageFault::kNone);
  CHECK(ImageCheck().check({nullptr, 10, 10, 10}) == ImageFault::kNone);
  CHECK(ImageCheck().check({Image(0).grey.data(), kWidth, kHeight, kWidth / 2}) == ImageFault::kNone);
}

namespace {

/// Dark bars on a light background, blurred and noisy, with new noise in every call.
std::vector<std::uint8_t> bars(int width, int height, double blur_px, double contrast, test::Random& random) {
  const double period_px = width / 16.0;
  std::vector<std::uint8_t> grey;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double bar = std::round(x / period_px) * period_px - x;  // distance from the nearest bar's middle
      const auto edge = [&](double at) { return 0.5 * std::erfc(at / (std::sqrt(2.0) * blur_px)); };
      const double ink = edge(std::abs(bar) - period_px / 4);
      grey.push_back(static_cast<std::uint8_t>(100 + contrast * (0.5 - ink) + 3 * random.normal()));
    }
  }
  return grey;
}

ImageFault after(ImageCheck& check, int images, int width, double blur_px, double contrast, test::Random& random) {
  ImageFault fault = ImageFault::kNone;
  for (int n = 0; n < images; ++n) {
    const auto grey = bars(width, 40, blur_px, contrast, random);
    fault = check.check({grey.data(), width, 40, width});
  }
  return fault;
}

}  // namespace

TEST_CASE("image check: out of focus for half a second is a fault, at either image size") {
  test::Random random(3);
  for (const auto& [width, sharp_px, blurred_px] : {std::tuple{1280, 1.5, 7.0}, {640, 1.0, 3.5}}) {
    ImageCheck check;
    CHECK(after(check, 40, width, sharp_px, 150, random) == ImageFault::kNone);
    CHECK(after(check, 29, width, blurred_px, 150, random) == ImageFault::kNone);
    CHECK(after(check, 1, width, blurred_px, 150, random) == ImageFault::kBlurred);
    CHECK(after(check, 1, width, sharp_px, 150, random) == ImageFault::kNone);
  }
}

TEST_CASE("image check: without contrast nothing is out of focus") {
  test::Random random(4);
  ImageCheck check;
  CHECK(after(check, 40, 640, 5, 30, random) == ImageFault::kNone);
}
