#include "firmware/vision/picture_check.h"

#include <doctest/doctest.h>

#include <cmath>
#include <vector>

#include "tests/random.h"

using namespace finsight;

namespace {

constexpr int kWidth = 100, kHeight = 50;  // not whole words

struct Picture {
  explicit Picture(int level, std::uint64_t seed = 0) : grey(kWidth * kHeight) {
    test::Random random(seed);
    for (std::uint8_t& pixel : grey) pixel = static_cast<std::uint8_t>(seed ? level + random.uniform() * 4 : level);
  }
  GreyView view() const { return {grey.data(), kWidth, kHeight, kWidth}; }
  std::vector<std::uint8_t> grey;
};

}  // namespace

TEST_CASE("picture check: noise is never taken for a frozen camera") {
  PictureCheck check;
  for (std::uint64_t frame = 1; frame < 100; ++frame)
    CHECK(check.look(Picture(100, frame).view()) == PictureFault::kNone);
}

TEST_CASE("picture check: the sixth equal picture is frozen, a new one ends it") {
  PictureCheck check;
  const Picture same(100, 1);
  for (int frame = 0; frame < 5; ++frame) CHECK(check.look(same.view()) == PictureFault::kNone);
  CHECK(check.look(same.view()) == PictureFault::kFrozen);
  CHECK(check.look(same.view()) == PictureFault::kFrozen);
  CHECK(check.look(Picture(100, 2).view()) == PictureFault::kNone);
  CHECK(check.look(same.view()) == PictureFault::kNone);
}

TEST_CASE("picture check: one pixel makes another picture") {
  PictureCheck check;
  Picture one(100, 1);
  for (int frame = 0; frame < 20; ++frame) {
    one.grey[8 * kWidth + 33] = static_cast<std::uint8_t>(frame);
    CHECK(check.look(one.view()) == PictureFault::kNone);
  }
}

TEST_CASE("picture check: up to four pictures in turn are frozen, five are not") {
  for (int ring = 2; ring <= 5; ++ring) {
    PictureCheck check;
    for (int frame = 0; frame < 40; ++frame) {
      const PictureFault fault = check.look(Picture(100, 1 + static_cast<std::uint64_t>(frame % ring)).view());
      CHECK((fault == PictureFault::kFrozen) == (ring <= 4 && frame >= ring + 4));
    }
  }
}

TEST_CASE("picture check: a dark picture that repeats is frozen, whatever little it shows") {
  PictureCheck check;
  Picture dark(1);
  dark.grey[8 * kWidth + 40] = 200;  // a lit marker on black
  for (int frame = 0; frame < 5; ++frame) CHECK(check.look(dark.view()) == PictureFault::kDark);
  CHECK(check.look(dark.view()) == PictureFault::kFrozen);
}

TEST_CASE("picture check: plain dark and bright pictures are, frozen or not") {
  PictureCheck check;
  for (int frame = 0; frame < 8; ++frame) CHECK(check.look(Picture(2).view()) == PictureFault::kDark);
  for (int frame = 0; frame < 8; ++frame) CHECK(check.look(Picture(255).view()) == PictureFault::kBright);
  CHECK(check.look(Picture(10, 1).view()) == PictureFault::kNone);
  CHECK(check.look(Picture(240, 1).view()) == PictureFault::kNone);
}

TEST_CASE("picture check: no picture is no fault of the picture's") {
  CHECK(PictureCheck().look({}) == PictureFault::kNone);
  CHECK(PictureCheck().look({nullptr, 10, 10, 10}) == PictureFault::kNone);
  CHECK(PictureCheck().look({Picture(0).grey.data(), kWidth, kHeight, kWidth / 2}) == PictureFault::kNone);
}

namespace {

/// Dark bars on light ground, blurred and noisy; every call another noise.
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

PictureFault after(PictureCheck& check, int pictures, int width, double blur_px, double contrast,
                   test::Random& random) {
  PictureFault fault = PictureFault::kNone;
  for (int n = 0; n < pictures; ++n) {
    const auto grey = bars(width, 40, blur_px, contrast, random);
    fault = check.look({grey.data(), width, 40, width});
  }
  return fault;
}

}  // namespace

TEST_CASE("picture check: out of focus for half a second is a fault, at either picture size") {
  test::Random random(3);
  for (const auto& [width, sharp_px, blurred_px] : {std::tuple{1280, 1.5, 7.0}, {640, 1.0, 3.5}}) {
    PictureCheck check;
    CHECK(after(check, 40, width, sharp_px, 150, random) == PictureFault::kNone);
    CHECK(after(check, 29, width, blurred_px, 150, random) == PictureFault::kNone);
    CHECK(after(check, 1, width, blurred_px, 150, random) == PictureFault::kBlurred);
    CHECK(after(check, 1, width, sharp_px, 150, random) == PictureFault::kNone);
  }
}

TEST_CASE("picture check: where there is nothing to see, nothing is out of focus") {
  test::Random random(4);
  PictureCheck check;
  CHECK(after(check, 40, 640, 5, 30, random) == PictureFault::kNone);
}
