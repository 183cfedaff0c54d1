#include <doctest/doctest.h>

#include <vector>

#include "firmware/ports/grey_conversion.h"

using namespace finsight;

namespace {

std::uint32_t fourcc(const char* code) {
  const auto byte = [code](int i) { return static_cast<std::uint32_t>(static_cast<unsigned char>(code[i])); };
  return byte(0) | byte(1) << 8 | byte(2) << 16 | byte(3) << 24;
}

/// One pixel's bytes in `code`, converted.
int grey_of(const char* code, std::vector<std::uint8_t> pixel) {
  const auto layout = grey_layout(fourcc(code));
  REQUIRE(layout);
  std::uint8_t grey = 0;
  pixel.resize(4);
  convert_to_grey(*layout, pixel.data(), 1, 1, 4, &grey);
  return grey;
}

}  // namespace

TEST_CASE("grey conversion: formats with a grey plane need none") {
  for (const char* code : {"R8  ", "YU12", "NV12", "NV21", "NV16"}) {
    REQUIRE(grey_layout(fourcc(code)));
    CHECK(grey_layout(fourcc(code))->is_grey_plane());
  }
}

TEST_CASE("grey conversion: compressed and Bayer formats are not supported") {
  for (const char* code : {"MJPG", "RGGB", "BA81", "R10 ", "    "}) CHECK(!grey_layout(fourcc(code)));
}

TEST_CASE("grey conversion: the cheaper format has the smaller rank") {
  CHECK(grey_layout(fourcc("NV12"))->rank < grey_layout(fourcc("YUYV"))->rank);
  CHECK(grey_layout(fourcc("YUYV"))->rank < grey_layout(fourcc("RG24"))->rank);
}

TEST_CASE("grey conversion: of packed YUV the Y bytes are used, in either order") {
  CHECK(grey_of("YUYV", {200, 1, 2, 3}) == 200);
  CHECK(grey_of("UYVY", {1, 200, 2, 3}) == 200);
}

TEST_CASE("grey conversion: red, green and blue are weighted as in BT.601, in any order in memory") {
  const double red = 0.299 * 255, green = 0.587 * 255, blue = 0.114 * 255;
  CHECK(grey_of("RG24", {0, 0, 255}) == doctest::Approx(red).epsilon(0.02));  // "RGB888": blue first
  CHECK(grey_of("RG24", {255, 0, 0}) == doctest::Approx(blue).epsilon(0.04));
  CHECK(grey_of("BG24", {255, 0, 0}) == doctest::Approx(red).epsilon(0.02));
  CHECK(grey_of("XR24", {0, 255, 0, 99}) == doctest::Approx(green).epsilon(0.02));
  CHECK(grey_of("XB24", {0, 0, 255, 99}) == doctest::Approx(blue).epsilon(0.04));
  CHECK(grey_of("XR24", {255, 255, 255, 255}) == 255);
}

TEST_CASE("grey conversion: rows are found by their stride, and their padding is ignored") {
  const std::vector<std::uint8_t> yuyv = {1, 9, 2, 9, 0xee, 0xee, 3, 9, 4, 9, 0xee, 0xee};
  std::vector<std::uint8_t> grey(4);
  convert_to_grey(*grey_layout(fourcc("YUYV")), yuyv.data(), 2, 2, 6, grey.data());
  CHECK(grey == std::vector<std::uint8_t>{1, 2, 3, 4});
}
