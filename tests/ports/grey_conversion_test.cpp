#include <doctest/doctest.h>

#include <vector>

#include "firmware/ports/grey_conversion.h"

using namespace finsight;

namespace {

/// One pixel's bytes in `code`, converted.
int grey_of(const char (&code)[5], std::vector<std::uint8_t> pixel) {
  const auto layout = grey_layout(four_characters(code));
  REQUIRE(layout);
  std::uint8_t grey = 0;
  pixel.resize(4);
  convert_to_grey(*layout, pixel.data(), 1, 1, 4, &grey);
  return grey;
}

}  // namespace

TEST_CASE("grey conversion: formats with a grey plane need none") {
  for (const std::uint32_t code : {four_characters("R8  "), four_characters("YU12"), four_characters("NV12"),
                                   four_characters("NV21"), four_characters("NV16")}) {
    REQUIRE(grey_layout(code));
    CHECK(grey_layout(code)->is_grey_plane());
  }
}

TEST_CASE("grey conversion: Bayer formats and unknown packings are not supported") {
  for (const std::uint32_t code : {four_characters("RGGB"), four_characters("BA81"), four_characters("    ")}) {
    CHECK(!grey_layout(code));
  }
  CHECK(!grey_layout(four_characters("R8  "), 5));
  CHECK(!grey_layout(four_characters("R16 "), std::uint64_t{12} << 56 | 1));  // compressed by the Pi 5
}

TEST_CASE("grey conversion: MJPEG is known as pictures that have to be decoded") {
  REQUIRE(grey_layout(four_characters("MJPG")));
  CHECK(grey_layout(four_characters("MJPG"))->is_jpeg);
  CHECK(!grey_layout(four_characters("MJPG"))->is_grey_plane());
}

TEST_CASE("grey conversion: of 10, 12 and 16 bits in words the upper 8 are used") {
  CHECK(grey_of("R10 ", {0xFF, 0x03}) == 255);
  CHECK(grey_of("R10 ", {0x03, 0x00}) == 0);
  CHECK(grey_of("R10 ", {0x34, 0x02}) == 0x234 / 4);
  CHECK(grey_of("R12 ", {0x34, 0x0A}) == 0xA34 / 16);
  CHECK(grey_of("R12 ", {0xFF, 0x0F}) == 255);
  CHECK(grey_of("R16 ", {0xFF, 0xAB}) == 0xAB);
  CHECK(grey_of("R10 ", {0xFF, 0xFF}) == 255);  // bits that the format does not have
}

TEST_CASE("grey conversion: of packed 10 and 12 bits the byte with the low bits is left out, also in a last group") {
  const std::vector<std::uint8_t> ten = {10, 20, 30, 40, 0xE4, 50, 60, 0, 0, 0xFF, 0xEE,
                                         11, 21, 31, 41, 0xE4, 51, 61, 0, 0, 0xFF, 0xEE};
  std::vector<std::uint8_t> grey(12);
  convert_to_grey(*grey_layout(four_characters("R10 "), kMipiPacked), ten.data(), 6, 2, 11, grey.data());
  CHECK(grey == std::vector<std::uint8_t>{10, 20, 30, 40, 50, 60, 11, 21, 31, 41, 51, 61});
  const std::vector<std::uint8_t> twelve = {1, 2, 0xFF, 3, 0, 0xFF, 4, 5, 0xFF, 6, 0, 0xFF};
  grey.resize(6);
  convert_to_grey(*grey_layout(four_characters("R12 "), kMipiPacked), twelve.data(), 3, 2, 6, grey.data());
  CHECK(grey == std::vector<std::uint8_t>{1, 2, 3, 4, 5, 6});
}

TEST_CASE("grey conversion: what is nearer to the sensor has the smaller rank") {
  CHECK(grey_layout(four_characters("R8  "))->rank < grey_layout(four_characters("R10 "))->rank);
  CHECK(grey_layout(four_characters("R10 "))->rank < grey_layout(four_characters("NV12"))->rank);
  CHECK(grey_layout(four_characters("RG24"))->rank < grey_layout(four_characters("MJPG"))->rank);
  CHECK(grey_layout(four_characters("NV12"))->rank < grey_layout(four_characters("YUYV"))->rank);
  CHECK(grey_layout(four_characters("YUYV"))->rank < grey_layout(four_characters("RG24"))->rank);
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
  convert_to_grey(*grey_layout(four_characters("YUYV")), yuyv.data(), 2, 2, 6, grey.data());
  CHECK(grey == std::vector<std::uint8_t>{1, 2, 3, 4});
}
