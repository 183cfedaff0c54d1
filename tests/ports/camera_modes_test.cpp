#include "firmware/ports/camera_modes.h"

#include <doctest/doctest.h>

#include <vector>

using namespace finsight;

namespace {

OfferedFormat offered(const char (&code)[5], double frames_per_second, std::uint64_t modifier = 0) {
  const auto layout = grey_layout(four_characters(code), modifier);
  REQUIRE(layout);
  return {code, *layout, frames_per_second};
}

std::string chosen(const std::vector<OfferedFormat>& formats, double frames_per_second = 60) {
  const auto best = choose_format(formats, frames_per_second);
  REQUIRE(best);
  return formats[best->index].name;
}

}  // namespace

TEST_CASE("camera modes: of formats that are fast enough the one nearest to the sensor is taken") {
  CHECK(chosen({offered("MJPG", 60), offered("YUYV", 60), offered("R8  ", 60)}) == "R8  ");
  CHECK(chosen({offered("MJPG", 60), offered("RG24", 60), offered("NV12", 60), offered("YUYV", 60)}) == "NV12");
  CHECK(chosen({offered("YUYV", 60), offered("R10 ", 60), offered("NV12", 60)}) == "R10 ");
  CHECK(chosen({offered("MJPG", 120), offered("YUYV", 59.94)}) == "YUYV");  // faster than wanted is no better
}

TEST_CASE("camera modes: MJPEG is taken where only it is fast enough, as in most USB cameras") {
  const std::vector<OfferedFormat> usb = {offered("YUYV", 10), offered("MJPG", 60)};
  CHECK(chosen(usb, 60) == "MJPG");
  CHECK(chosen(usb, 10) == "YUYV");
  const std::string why = choose_format(usb, 60)->why;
  CHECK(why.find("MJPG, up to 60/s") == 0);
  CHECK(why.find("compressed, which costs accuracy") != std::string::npos);
  CHECK(why.find("not YUYV (up to 10/s)") != std::string::npos);
}

TEST_CASE(
    "camera modes: where none is fast enough the fastest is taken, and a rate that is not told counts as enough") {
  CHECK(chosen({offered("YUYV", 10), offered("MJPG", 30), offered("RG24", 5)}) == "MJPG");
  CHECK(choose_format(std::vector{offered("YUYV", 10)}, 60)->why.find("none reaches") != std::string::npos);
  CHECK(chosen({offered("YUYV", 30), offered("NV12", 30)}) == "NV12");
  CHECK(chosen({offered("MJPG", 0), offered("YUYV", 0)}) == "YUYV");
  CHECK(!choose_format({}, 60));
}

TEST_CASE("frame rate meter: the camera's own counter tells its rate, also of frames that nobody took") {
  FrameRateMeter meter(60);
  CHECK(meter.rate_hz() == 0);
  CHECK(!meter.is_slow());
  int rates = 0;
  for (std::uint32_t k = 0; k < 300; k += 3) rates += meter.note(1000 + k, 7'000 + std::int64_t{k} * 25'000'000);
  CHECK(rates == 3);
  CHECK(meter.rate_hz() == doctest::Approx(40));
  CHECK(!meter.is_slow());
  meter.restart();
  CHECK(meter.rate_hz() == 0);
  for (std::uint32_t k = 0; k < 100; ++k) meter.note(k, std::int64_t{k} * 34'000'000);
  CHECK(meter.is_slow());
}

TEST_CASE("frame rate meter: a counter that goes back begins a new count") {
  FrameRateMeter meter(60);
  meter.note(5000, 0);
  CHECK(!meter.note(3, 3'000'000'000));
  CHECK(meter.note(123, 5'000'000'000));
  CHECK(meter.rate_hz() == doctest::Approx(60));
}
