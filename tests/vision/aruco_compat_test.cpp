#include "firmware/vision/aruco_compat.h"

#include <doctest/doctest.h>

#include <set>
#include <stdexcept>

#include "tests/vision/test_finger.h"

using namespace finsight;
using namespace finsight::test;

namespace {

/// A lens without distortion that shows a marker at z = 100 mm with `side_px`.
CameraModel small_camera(double side_px) {
  CameraModel camera;
  camera.width_px = camera.height_px = 160;
  camera.fx = camera.fy = static_cast<float>(side_px * 100 / 8);
  camera.cx = camera.cy = 79.5F;
  return camera;
}

PaintedMarker upright(int id, double x_mm = 0) {
  return {id, 8,
          Eigen::Translation3d(x_mm, 0, 100) * Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitX()) *
              Eigen::Isometry3d::Identity()};
}

Paint quick_paint() {
  Paint paint;
  paint.samples = 11;
  return paint;
}

GreyView view(const CameraModel& camera, const std::vector<std::uint8_t>& grey) {
  return {grey.data(), camera.width_px, camera.height_px, camera.width_px};
}

constexpr SideLimits kSides{20, 120};

}  // namespace

TEST_CASE("marker modules: 50 different codes in a black border") {
  std::set<std::array<std::uint8_t, 36>> codes;
  for (int id = 0; id < kDictionaryMarkers; ++id) {
    const std::array<std::uint8_t, 36> modules = marker_modules(id);
    codes.insert(modules);
    for (std::size_t i = 0; i < 36; ++i) {
      const std::size_t row = i / 6, column = i % 6;
      CHECK(modules[i] <= 1);
      if (row == 0 || row == 5 || column == 0 || column == 5) CHECK(modules[i] == 0);
    }
  }
  CHECK(codes.size() == 50);
  CHECK_THROWS_AS(marker_modules(-1), std::invalid_argument);
  CHECK_THROWS_AS(marker_modules(50), std::invalid_argument);
}

TEST_CASE("detector: every marker of the dictionary is read back, its corners in order from its own top left") {
  const CameraModel camera = small_camera(48);
  MarkerDetector detector;
  for (int id = 0; id < kDictionaryMarkers; ++id) {
    Picture picture(camera, quick_paint());
    picture.add(upright(id));
    const std::vector<std::uint8_t> grey = picture.develop(static_cast<std::uint64_t>(id));
    for (const int shrink : {1, 2}) {
      const std::vector<FoundMarker>& found = detector.find(view(camera, grey), shrink, kSides);
      REQUIRE(found.size() == 1);
      CHECK(found[0].id == id);
      const std::array<Vec2f, 4> truth = true_corners(camera, upright(id));
      for (std::size_t k = 0; k < 4; ++k) {
        CHECK((found[0].corners_px[k] - truth[k]).norm() < 1.5F * static_cast<float>(shrink));
      }
    }
  }
}

TEST_CASE("detector: a code with one wrong bit is nobody's") {
  const CameraModel camera = small_camera(48);
  MarkerDetector detector;
  for (int bit = 0; bit < 16; ++bit) {
    std::array<std::uint8_t, 36> modules = marker_modules(7);
    modules[static_cast<std::size_t>((bit / 4 + 1) * 6 + bit % 4 + 1)] ^= 1;
    Picture picture(camera, quick_paint());
    picture.add(upright(7), modules);
    CHECK(detector.find(view(camera, picture.develop(1)), 1, kSides).empty());
  }
}

TEST_CASE("detector: an inverted marker is none") {
  const CameraModel camera = small_camera(48);
  std::array<std::uint8_t, 36> modules = marker_modules(7);
  for (std::uint8_t& module : modules) module ^= 1;
  Picture picture(camera, quick_paint());
  picture.add(upright(7), modules);
  MarkerDetector detector;
  CHECK(detector.find(view(camera, picture.develop(1)), 1, kSides).empty());
}

TEST_CASE("detector: the same id at two places is listed twice, one print once") {
  const CameraModel camera = small_camera(40);
  Picture picture(camera, quick_paint());
  picture.add(upright(5, -7));
  picture.add(upright(5, 7));
  MarkerDetector detector;
  const std::vector<FoundMarker>& found = detector.find(view(camera, picture.develop(1)), 1, kSides);
  REQUIRE(found.size() == 2);
  CHECK(found[0].id == 5);
  CHECK(found[1].id == 5);
}

TEST_CASE("detector: squares outside the limits are not looked at") {
  const CameraModel camera = small_camera(48);
  Picture picture(camera, quick_paint());
  picture.add(upright(7));
  const std::vector<std::uint8_t> grey = picture.develop(1);
  MarkerDetector detector;
  CHECK(detector.find(view(camera, grey), 1, {60, 120}).empty());
  CHECK(detector.find(view(camera, grey), 1, {10, 36}).empty());
  CHECK(detector.find(view(camera, grey), 1, {40, 60}).size() == 1);
}

TEST_CASE("detector: what OpenCV objects to is an empty list") {
  MarkerDetector detector;
  const std::vector<std::uint8_t> grey(64, 100);
  CHECK(detector.find({}, 1, kSides).empty());
  CHECK(detector.find({grey.data(), 2, 2, 8}, 4, kSides).empty());
  CHECK(detector.find({grey.data(), 8, 8, 8}, 1, {std::nanf(""), -1}).empty());
}
