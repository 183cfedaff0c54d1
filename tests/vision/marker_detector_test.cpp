#include "firmware/vision/marker_detector.h"

#include <doctest/doctest.h>

#include <opencv2/core.hpp>
#if CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR <= 6
#include <opencv2/aruco.hpp>
#else
#include <opencv2/objdetect/aruco_detector.hpp>
#endif

#include "firmware/vision/aruco_compat.h"
#include "tests/vision/test_finger.h"

using namespace finsight;
using namespace finsight::test;

namespace {

/// A lens without distortion that shows a marker at z = 100 mm with `side_px`.
Lens small_camera(double side_px) {
  Lens camera;
  camera.width_px = camera.height_px = 160;
  camera.fx = camera.fy = side_px * 100 / 8;
  camera.cx = camera.cy = 79.5;
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

ImageView view(const Lens& camera, const std::vector<std::uint8_t>& grey) {
  return {grey.data(), camera.width_px, camera.height_px, camera.width_px};
}

constexpr SideLimits kSides{20, 120};

/// Found by OpenCV's own detector with its defaults.
std::vector<int> ids_by_opencv(const Lens& camera, const std::vector<std::uint8_t>& grey) {
  const cv::Mat pixels(camera.height_px, camera.width_px, CV_8UC1, const_cast<std::uint8_t*>(grey.data()));
  const auto dictionary = cv::aruco::getPredefinedDictionary(cv::aruco::DICT_4X4_50);
  std::vector<std::vector<cv::Point2f>> corners;
  std::vector<int> ids;
#if CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR <= 6
  cv::aruco::detectMarkers(pixels, dictionary, corners, ids);
#else
  cv::aruco::ArucoDetector(dictionary).detectMarkers(pixels, corners, ids);
#endif
  return ids;
}

}  // namespace

TEST_CASE("detector: every marker of the dictionary is read back, its corners in order from its own top left") {
  const Lens camera = small_camera(48);
  MarkerDetector detector;
  for (int id = 0; id < kDictionaryMarkers; ++id) {
    Image image(camera, quick_paint());
    image.add(upright(id));
    const std::vector<std::uint8_t> grey = image.develop(static_cast<std::uint64_t>(id));
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

TEST_CASE("detector: a code with one wrong bit is not accepted") {
  const Lens camera = small_camera(48);
  MarkerDetector detector;
  for (int bit = 0; bit < 16; ++bit) {
    std::array<std::uint8_t, 36> modules = marker_modules(7);
    modules[static_cast<std::size_t>((bit / 4 + 1) * 6 + bit % 4 + 1)] ^= 1;
    Image image(camera, quick_paint());
    image.add(upright(7), modules);
    CHECK(detector.find(view(camera, image.develop(1)), 1, kSides).empty());
  }
}

TEST_CASE("detector: an inverted marker is not accepted") {
  const Lens camera = small_camera(48);
  std::array<std::uint8_t, 36> modules = marker_modules(7);
  for (std::uint8_t& module : modules) module ^= 1;
  Image image(camera, quick_paint());
  image.add(upright(7), modules);
  MarkerDetector detector;
  CHECK(detector.find(view(camera, image.develop(1)), 1, kSides).empty());
}

TEST_CASE("detector: an id at two places is listed twice, a single marker once") {
  const Lens camera = small_camera(40);
  Image image(camera, quick_paint());
  image.add(upright(5, -7));
  image.add(upright(5, 7));
  MarkerDetector detector;
  const std::vector<FoundMarker>& found = detector.find(view(camera, image.develop(1)), 1, kSides);
  REQUIRE(found.size() == 2);
  CHECK(found[0].id == 5);
  CHECK(found[1].id == 5);
}

TEST_CASE("detector: squares outside the size limits are ignored") {
  const Lens camera = small_camera(48);
  Image image(camera, quick_paint());
  image.add(upright(7));
  const std::vector<std::uint8_t> grey = image.develop(1);
  MarkerDetector detector;
  CHECK(detector.find(view(camera, grey), 1, {60, 120}).empty());
  CHECK(detector.find(view(camera, grey), 1, {10, 36}).empty());
  CHECK(detector.find(view(camera, grey), 1, {40, 60}).size() == 1);
}

TEST_CASE("detector: an image that OpenCV rejects gives an empty list") {
  MarkerDetector detector;
  const std::vector<std::uint8_t> grey(64, 100);
  CHECK(detector.find({}, 1, kSides).empty());
  CHECK(detector.find({grey.data(), 2, 2, 8}, 4, kSides).empty());
  CHECK(detector.find({grey.data(), 8, 8, 8}, 1, {std::nanf(""), -1}).empty());
}

TEST_CASE("detector: finds what OpenCV's own detector finds, and nothing else, in noise and at any tilt") {
  const Lens camera = small_camera(40);
  MarkerDetector detector;
  Random random(5);
  int theirs = 0, ours = 0;
  for (int n = 0; n < 60; ++n) {
    Paint paint = quick_paint();
    paint.read_noise = random.uniform(0, 8);
    paint.blur_px = random.uniform(0.5, 1.6);
    PaintedMarker marker = upright(n % kDictionaryMarkers);
    const Eigen::Vector3d axis = Eigen::Vector3d(random.normal(), random.normal(), 3 * random.normal()).normalized();
    marker.T_camera_marker.rotate(Eigen::AngleAxisd(random.uniform(0, 0.7), axis));
    Image image(camera, paint);
    image.add(marker);
    const std::vector<std::uint8_t> grey = image.develop(static_cast<std::uint64_t>(n));
    const std::vector<FoundMarker>& found = detector.find(view(camera, grey), 1, kSides);
    REQUIRE(found.size() <= 1);
    theirs += ids_by_opencv(camera, grey) == std::vector{marker.id};
    ours += found.size() == 1;
    if (found.empty()) continue;
    CHECK(found[0].id == marker.id);
    const std::array<Vec2f, 4> truth = true_corners(camera, marker);
    for (std::size_t k = 0; k < 4; ++k) CHECK((found[0].corners_px[k] - truth[k]).norm() < 3);
  }
  MESSAGE("found of 60: OpenCV ", theirs, ", ours ", ours);
  CHECK(theirs > 30);
  CHECK(ours >= theirs);
}

TEST_CASE("detector: noise has no squares worth reading") {
  const Lens camera = small_camera(40);
  MarkerDetector detector;
  Random random(7);
  for (const double sigma : {5.0, 20.0, 80.0}) {
    std::vector<std::uint8_t> grey(static_cast<std::size_t>(camera.width_px * camera.height_px));
    for (std::uint8_t& pixel : grey)
      pixel = static_cast<std::uint8_t>(std::clamp(128 + sigma * random.normal(), 0.0, 255.0));
    CHECK(detector.find(view(camera, grey), 1, kSides).empty());
    CHECK(detector.squares_read() < 3);
  }
}

TEST_CASE("detector: of too many squares it reads the largest") {
  Lens camera = small_camera(60);
  Image image(camera, quick_paint());
  image.add(upright(7));
  std::vector<std::uint8_t> grey = image.develop(1);
  for (int row = 0; row < 160; row += 16) {  // 20 empty squares of 12 pixels to the left and right of it
    for (const int column : {4, 144}) {
      for (int i = 0; i < 12 * 12; ++i) {
        grey[static_cast<std::size_t>((row + 2 + i / 12) * 160 + column + i % 12)] = 10;
      }
    }
  }
  constexpr SideLimits kAny{8, 120};
  MarkerDetector patient, hasty({.squares = 8});
  CHECK(patient.find(view(camera, grey), 1, kAny).size() == 1);
  CHECK(patient.squares_read() > 20);
  CHECK(hasty.find(view(camera, grey), 1, kAny).size() == 1);
  CHECK(hasty.squares_read() == 8);
}

TEST_CASE("detector: an image full of edges is not searched") {
  const Lens camera = small_camera(60);
  Image image(camera, quick_paint());
  image.add(upright(7));
  const std::vector<std::uint8_t> grey = image.develop(1);
  MarkerDetector usual, strict({.noisy_edges = 200, .edges = 200});
  CHECK(usual.find(view(camera, grey), 1, kSides).size() == 1);
  CHECK(strict.find(view(camera, grey), 1, kSides).empty());
  CHECK(strict.squares_read() == 0);
}
