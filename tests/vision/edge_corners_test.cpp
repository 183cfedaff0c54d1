#include "firmware/vision/edge_corners.h"

#include <doctest/doctest.h>

#include <opencv2/imgproc.hpp>

#include "tests/vision/test_finger.h"

using namespace finsight;
using namespace finsight::test;

namespace {

/// Squares of 35 ... 80 pixels anywhere in the image, rotated at random and tilted by `tilt_rad`.
PaintedMarker random_marker(Random& random, const Lens& camera, double tilt_rad) {
  const double side_px = random.uniform(35, 80), z = 8 * camera.fx / side_px;
  const double angle = random.uniform(-3.14, 3.14);
  PaintedMarker marker;
  marker.id = static_cast<int>(random.uniform(0, 50));
  marker.T_camera_marker = Eigen::Translation3d(random.uniform(-0.3, 0.3) * z, random.uniform(-0.2, 0.2) * z, z) *
                           Eigen::AngleAxisd(random.uniform(-3.14, 3.14), Eigen::Vector3d::UnitZ()) *
                           Eigen::AngleAxisd(tilt_rad, Eigen::Vector3d(std::cos(angle), std::sin(angle), 0)) *
                           Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitX());
  return marker;
}

struct Errors {
  double squares = 0, outward = 0, worst = 0;
  int count = 0;
  void add(const std::array<Vec2f, 4>& found, const std::array<Vec2f, 4>& truth) {
    const Vec2f centre = (truth[0] + truth[1] + truth[2] + truth[3]) / 4;
    for (std::size_t k = 0; k < 4; ++k) {
      const Vec2f error = found[k] - truth[k];
      squares += error.squaredNorm();
      outward += error.dot((truth[k] - centre).normalized());
      worst = std::max<double>(worst, error.norm());
      ++count;
    }
  }
  double rms() const { return std::sqrt(squares / (2 * count)); }  ///< per coordinate
  double bias() const { return outward / count; }                  ///< away from the marker's centre
};

std::array<Vec2f, 4> shifted(const std::array<Vec2f, 4>& corners, Random& random, double by_px) {
  std::array<Vec2f, 4> moved = corners;
  for (Vec2f& corner : moved) {
    const double angle = random.uniform(-3.14, 3.14);
    corner += (by_px * Eigen::Vector2d(std::cos(angle), std::sin(angle))).cast<float>();
  }
  return moved;
}

std::array<Vec2f, 4> by_corner_sub_pix(const Lens& camera, std::vector<std::uint8_t>& grey,
                                       const std::array<Vec2f, 4>& start) {
  std::vector<cv::Point2f> points;
  for (const Vec2f& corner : start) points.emplace_back(corner.x(), corner.y());
  cv::cornerSubPix(cv::Mat(camera.height_px, camera.width_px, CV_8UC1, grey.data()), points, {3, 3}, {-1, -1},
                   {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 40, 0.01});
  std::array<Vec2f, 4> corners;
  for (std::size_t k = 0; k < 4; ++k) corners[k] = {points[k].x, points[k].y};
  return corners;
}

/// A marker that faces the camera, in a picture that a test spoils.
struct FacedMarker {
  explicit FacedMarker(double distance_mm) {
    PaintedMarker marker;
    marker.T_camera_marker =
        Eigen::Translation3d(0, 0, distance_mm) * Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitX());
    Image image(camera, Paint{});
    image.add(marker);
    grey = image.develop(5);
    truth = true_corners(camera, marker);
  }
  /// Adds what ink and paper reflect alike, grey levels by place; the picture ends at 255.
  template <class Glare>
  void shine(const Glare& glare) {
    for (int y = 0; y < camera.height_px; ++y) {
      for (int x = 0; x < camera.width_px; ++x) {
        std::uint8_t& pixel = grey[static_cast<std::size_t>(y * camera.width_px + x)];
        const float light = static_cast<float>(pixel) + glare(Vec2f(static_cast<float>(x), static_cast<float>(y)));
        pixel = static_cast<std::uint8_t>(std::min(255.0F, light));
      }
    }
  }
  void check_corners(float largest_px) {
    std::array<Vec2f, 4> corners = truth;
    REQUIRE(refine_corners({grey.data(), camera.width_px, camera.height_px, camera.width_px}, camera, corners));
    for (std::size_t k = 0; k < 4; ++k) CHECK((corners[k] - truth[k]).norm() < largest_px);
  }
  Lens camera = camera_640x480();
  std::vector<std::uint8_t> grey;
  std::array<Vec2f, 4> truth;
};

}  // namespace

TEST_CASE("corners: a few hundredths of a pixel from the truth, and far better than cornerSubPix") {
  const Lens camera = camera_640x480();
  for (const double blur_px : {0.5, 0.7, 1.0}) {
    for (const double tilt_rad : {0.0, 0.35, 0.7}) {
      Errors edges, sub_pix;
      Random random(11);
      for (int i = 0; i < 6; ++i) {
        const PaintedMarker marker = random_marker(random, camera, tilt_rad);
        Paint paint;
        paint.blur_px = blur_px;
        Image image(camera, paint);
        image.add(marker);
        std::vector<std::uint8_t> grey = image.develop(static_cast<std::uint64_t>(i));
        const std::array<Vec2f, 4> truth = true_corners(camera, marker), start = shifted(truth, random, 1.5);
        std::array<Vec2f, 4> corners = start;
        REQUIRE(refine_corners({grey.data(), camera.width_px, camera.height_px, camera.width_px}, camera, corners));
        edges.add(corners, truth);
        sub_pix.add(by_corner_sub_pix(camera, grey, shifted(truth, random, 0.5)), truth);
      }
      INFO("blur ", blur_px, " tilt ", tilt_rad, ": edges bias ", edges.bias(), " RMS ", edges.rms(), " worst ",
           edges.worst, "; cornerSubPix bias ", sub_pix.bias(), " RMS ", sub_pix.rms());
      CHECK(edges.rms() < 0.05);
      CHECK(std::abs(edges.bias()) < 0.03);
      CHECK(edges.worst < 0.25);
      CHECK(edges.rms() < sub_pix.rms() / 3);
    }
  }
}

TEST_CASE("corners: their own scatter is told within a factor of 1.6, and more blur is told as more") {
  const Lens camera = camera_640x480();
  for (const double read_noise : {4.0, 8.0, 16.0}) {
    Errors edges;
    Random random(11);
    double told_sq = 0;
    constexpr int kImages = 12;
    for (int i = 0; i < kImages; ++i) {
      const PaintedMarker marker = random_marker(random, camera, 0.2);
      Paint paint;
      paint.read_noise = read_noise;
      Image image(camera, paint);
      image.add(marker);
      const std::vector<std::uint8_t> grey = image.develop(static_cast<std::uint64_t>(i));
      const std::array<Vec2f, 4> truth = true_corners(camera, marker);
      std::array<Vec2f, 4> corners = truth;
      const auto quality =
          refine_corners({grey.data(), camera.width_px, camera.height_px, camera.width_px}, camera, corners);
      REQUIRE(quality);
      edges.add(corners, truth);
      told_sq += static_cast<double>(quality->scatter_px * quality->scatter_px) / kImages;
    }
    const double ratio = std::sqrt(told_sq) / edges.rms();
    INFO("noise ", read_noise, ": told ", std::sqrt(told_sq), ", is ", edges.rms());
    CHECK(ratio > 1 / 1.6);
    CHECK(ratio < 1.6);
  }
  float before_px = 0;
  for (const double blur_px : {0.5, 1.0, 1.5, 2.0}) {
    Random random(3);
    const PaintedMarker marker = random_marker(random, camera, 0.2);
    Paint paint;
    paint.blur_px = blur_px;
    Image image(camera, paint);
    image.add(marker);
    const std::vector<std::uint8_t> grey = image.develop(1);
    std::array<Vec2f, 4> corners = true_corners(camera, marker);
    const auto quality =
        refine_corners({grey.data(), camera.width_px, camera.height_px, camera.width_px}, camera, corners);
    REQUIRE(quality);
    CHECK(quality->blur_px > before_px);
    before_px = quality->blur_px;
  }
}

TEST_CASE("corners: exact to 0.02 pixels without noise, where the lens bends the edges most") {
  Lens camera = camera_1280x720();
  Paint paint;
  paint.read_noise = paint.shot_noise = paint.light_gradient = 0;
  PaintedMarker marker;
  marker.T_camera_marker = Eigen::Translation3d(-45, -20, 70) * Eigen::AngleAxisd(3.1, Eigen::Vector3d::UnitX());
  Image image(camera, paint);
  image.add(marker);
  const std::vector<std::uint8_t> grey = image.develop(0);
  const std::array<Vec2f, 4> truth = true_corners(camera, marker);
  std::array<Vec2f, 4> corners = truth;
  for (Vec2f& corner : corners) corner += Vec2f(1, -1);
  REQUIRE(refine_corners({grey.data(), camera.width_px, camera.height_px, camera.width_px}, camera, corners));
  for (std::size_t k = 0; k < 4; ++k) CHECK((corners[k] - truth[k]).norm() < 0.02F);
}

TEST_CASE("corners: the coding of grey levels, where it is known, does not move the edges") {
  const Lens camera = camera_640x480();
  Paint paint;
  paint.read_noise = paint.shot_noise = paint.light_gradient = 0;
  paint.blur_px = 1;
  PaintedMarker marker;
  marker.T_camera_marker = Eigen::Translation3d(3, 2, 70) * Eigen::AngleAxisd(3.1, Eigen::Vector3d::UnitX());
  Image image(camera, paint);
  image.add(marker);
  std::vector<std::uint8_t> grey = image.develop(0);
  for (std::uint8_t& level : grey) {  // as IEC 61966-2-1 codes light
    const double light = level / 255.0;
    const double coded = light <= 0.0031308 ? 12.92 * light : 1.055 * std::pow(light, 1 / 2.4) - 0.055;
    level = static_cast<std::uint8_t>(std::lround(255 * coded));
  }
  const std::array<Vec2f, 4> truth = true_corners(camera, marker);
  const auto worst_px = [&](Coding coding) {
    std::array<Vec2f, 4> corners = truth;
    REQUIRE(refine_corners({grey.data(), camera.width_px, camera.height_px, camera.width_px, coding}, camera, corners));
    float worst = 0;
    for (std::size_t k = 0; k < 4; ++k) worst = std::max(worst, (corners[k] - truth[k]).norm());
    return worst;
  };
  CHECK(worst_px(Coding::kLinear) > 0.1F);
  CHECK(worst_px(Coding::kSrgb) < 0.07F);
}

TEST_CASE("corners: dirt on a quarter of an edge does not bend it") {
  FacedMarker seen(70);
  const int y = static_cast<int>(seen.truth[0].y());
  const int x = static_cast<int>(seen.truth[0].x() + 0.5F * (seen.truth[1].x() - seen.truth[0].x()));
  for (int row = y - 3; row < y; ++row) {
    for (int column = x; column < x + 10; ++column) {
      seen.grey[static_cast<std::size_t>(row * seen.camera.width_px + column)] = 30;
    }
  }
  seen.check_corners(0.15F);
}

TEST_CASE("corners: a highlight that hides a part of an edge does not move it") {
  FacedMarker seen(70);
  const Vec2f spot = seen.truth[0] + 0.25F * (seen.truth[1] - seen.truth[0]);
  seen.shine([&](const Vec2f& at) { return 120 * std::exp(-(at - spot).squaredNorm() / 50); });
  seen.check_corners(0.15F);
}

TEST_CASE("corners: glare along a whole edge, whose paper is brighter than the picture can show, hardly moves it") {
  FacedMarker seen(90);
  const float edge_y = std::max(seen.truth[0].y(), seen.truth[2].y());
  seen.shine([&](const Vec2f& at) { return 140 * std::exp(-std::pow(at.y() - edge_y - 4, 2.0F) / 100); });
  seen.check_corners(0.25F);
}

TEST_CASE("corners: without edges there are no corners") {
  const Lens camera = camera_640x480();
  const std::vector<std::uint8_t> flat(640 * 480, 120);
  const ImageView image{flat.data(), 640, 480, 640};
  const std::array<Vec2f, 4> square{Vec2f(100, 100), Vec2f(150, 100), Vec2f(150, 150), Vec2f(100, 150)};
  std::array<Vec2f, 4> corners = square;
  CHECK(!refine_corners(image, camera, corners));
  CHECK(corners == square);

  corners = {Vec2f(-20, -20), Vec2f(30, -20), Vec2f(30, 30), Vec2f(-20, 30)};  // reaches out of the image
  CHECK(!refine_corners(image, camera, corners));
  corners.fill(Vec2f(100, 100));  // no area
  CHECK(!refine_corners(image, camera, corners));
  corners.fill(Vec2f::Constant(std::nanf("")));
  CHECK(!refine_corners(image, camera, corners));
}
