#include "firmware/vision/rolling_shutter.h"

#include <doctest/doctest.h>

using namespace finsight;

namespace {

constexpr int kHeight = 480;
constexpr std::int64_t kFrame_ns = 16'666'667, kReadout_ns = 15'000'000;
const Vec2f kSpeed_px_s(300, 200);
const std::array<Vec2f, 4> kSquare = {Vec2f(-20, -20), Vec2f(20, -20), Vec2f(20, 20), Vec2f(-20, 20)};

Frame frame(int number) {
  return {.height_px = kHeight,
          .exposure_ns = 1'000'000'000 + number * kFrame_ns,
          .sequence = static_cast<std::uint32_t>(number)};
}

Vec2f truth(const Vec2f& start, std::size_t corner, double time_ns) {
  return start + kSquare[corner] + kSpeed_px_s * static_cast<float>(time_ns / 1e9);
}

/// Each corner where it was when its row was exposed.
MarkerCorners seen(const Vec2f& start, int number) {
  MarkerCorners corners;
  corners.seen = {true, false, false};
  for (std::size_t k = 0; k < 4; ++k) {
    const double frame_ns = static_cast<double>(number) * kFrame_ns;
    Vec2f at = truth(start, k, frame_ns);
    for (int i = 0; i < 20; ++i) {
      at = truth(start, k, frame_ns + static_cast<double>(kReadout_ns) * (static_cast<double>(at.y()) / kHeight - 0.5));
    }
    corners.corners_px[0][k] = at;
  }
  return corners;
}

float largest_error_px(const MarkerCorners& corners, const Vec2f& start, int number) {
  float largest = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    const Vec2f off = corners.corners_px[0][k] - truth(start, k, static_cast<double>(number) * kFrame_ns);
    largest = std::max(largest, off.norm());
  }
  return largest;
}

}  // namespace

TEST_CASE("rolling shutter: corners of an evenly moving marker come to where they were at the frame's time") {
  for (const float row : {40.0F, 240.0F, 400.0F}) {
    CAPTURE(row);
    const Vec2f start(100, row);
    RollingShutter shutter(kReadout_ns);
    MarkerCorners corners = seen(start, 0);
    shutter.straighten(frame(0), corners);
    CHECK(largest_error_px(corners, start, 0) == largest_error_px(seen(start, 0), start, 0));  // no speed is known yet
    for (int number = 1; number < 4; ++number) {
      corners = seen(start, number);
      const float before_px = largest_error_px(corners, start, number);
      shutter.straighten(frame(number), corners);
      CHECK(before_px > 0.2F);
      CHECK(largest_error_px(corners, start, number) < 0.01F);
    }
  }
}

TEST_CASE("rolling shutter: nothing changes for a global shutter, a still marker, or one that was away for long") {
  const Vec2f start(100, 40);
  RollingShutter global(0), rolling(kReadout_ns);
  MarkerCorners corners = seen(start, 0);
  global.straighten(frame(0), corners);
  corners = seen(start, 1);
  global.straighten(frame(1), corners);
  CHECK(corners.corners_px[0] == seen(start, 1).corners_px[0]);

  corners = seen(start, 0);
  rolling.straighten(frame(0), corners);
  corners = seen(start, 0);
  rolling.straighten(frame(1), corners);
  CHECK(largest_error_px(corners, start, 0) == doctest::Approx(largest_error_px(seen(start, 0), start, 0)));
  corners = seen(start, 10);
  rolling.straighten(frame(10), corners);
  CHECK(corners.corners_px[0] == seen(start, 10).corners_px[0]);

  // Two frames that were handed over at once, with the times of that.
  Frame burst = frame(10);
  burst.exposure_ns += kNsPerMs;
  corners = seen(start, 11);
  rolling.straighten(burst, corners);
  CHECK(corners.corners_px[0] == seen(start, 11).corners_px[0]);
}
