#include "firmware/vision/picture_check.h"

#include <doctest/doctest.h>

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

TEST_CASE("picture check: two pictures in turn are not frozen, and one pixel makes another picture") {
  PictureCheck check;
  Picture one(100, 1);
  for (int frame = 0; frame < 20; ++frame) {
    one.grey[8 * kWidth + 33] = static_cast<std::uint8_t>(frame % 2);
    CHECK(check.look(one.view()) == PictureFault::kNone);
  }
}

TEST_CASE("picture check: dark and bright pictures are, frozen or not") {
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
