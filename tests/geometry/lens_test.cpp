#include "firmware/geometry/lens.h"

#include <doctest/doctest.h>

#include <limits>
#include <opencv2/calib3d.hpp>

#include "firmware/input_error.h"
#include "tests/vision/test_finger.h"

using namespace finsight;
using namespace finsight::test;

namespace {

Lens tangential_lens() {
  Lens lens = camera_1280x720();
  lens.p1 = 0.004;
  lens.p2 = -0.003;
  return lens;
}

}  // namespace

TEST_CASE("lens: projects like OpenCV's projectPoints") {
  const Lens lens = tangential_lens();
  Random random(1);
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector2d ray(random.uniform(-0.7, 0.7), random.uniform(-0.5, 0.5));
    std::vector<cv::Point2d> expected;
    const cv::Matx33d intrinsic(lens.fx, 0, lens.cx, 0, lens.fy, lens.cy, 0, 0, 1);
    const cv::Matx<double, 1, 5> distortion(lens.k1, lens.k2, lens.p1, lens.p2, lens.k3);
    cv::projectPoints(std::vector<cv::Point3d>{{3 * ray.x(), 3 * ray.y(), 3}}, cv::Vec3d::all(0), cv::Vec3d::all(0),
                      intrinsic, distortion, expected);
    const Eigen::Vector2d found = pixel_from_ray(lens, ray);
    CHECK(found.x() == doctest::Approx(expected[0].x).epsilon(1e-9));
    CHECK(found.y() == doctest::Approx(expected[0].y).epsilon(1e-9));
  }
}

TEST_CASE("lens: the slope of the projection is its finite difference") {
  const Lens lens = tangential_lens();
  const Eigen::Vector2d ray(0.41, -0.33);
  const Projection projection = project_ray(lens, ray);
  constexpr double kStep = 1e-6;
  for (int axis = 0; axis < 2; ++axis) {
    const Eigen::Vector2d step = kStep * Eigen::Vector2d::Unit(axis);
    const Eigen::Vector2d slope = (pixel_from_ray(lens, ray + step) - pixel_from_ray(lens, ray - step)) / (2 * kStep);
    CHECK((projection.slope.col(axis) - slope).norm() < 1e-4);
  }
}

TEST_CASE("lens: pixel to ray and back is the same pixel, up to where the lens model folds over") {
  for (const Lens& lens : {camera_1280x720(), camera_640x480(), tangential_lens()}) {
    for (double angle = 0; angle < 6.3; angle += 0.1) {
      for (double share = 0; share <= 0.74; share += 0.02) {  // these coefficients fold at 0.76 focal lengths
        const Eigen::Vector2d pixel(lens.cx + share * lens.fx * std::cos(angle),
                                    lens.cy + share * lens.fy * std::sin(angle));
        CHECK((pixel_from_ray(lens, ray_from_pixel(lens, pixel)) - pixel).norm() < 1e-5);
      }
    }
  }
}

TEST_CASE("lens: where the distortion turns back there is no ray") {
  const Lens lens = camera_1280x720();
  CHECK(ray_from_pixel(lens, {1000, 365}).allFinite());
  CHECK(!ray_from_pixel(lens, {1279, 719}).allFinite());
  CHECK(!ray_from_pixel(lens, {3000, 365}).allFinite());
  CHECK(!ray_from_pixel(lens, {std::nan(""), 365}).allFinite());
}

TEST_CASE("lens: the turning radius is where the image of longer rays comes back towards the middle") {
  const Lens lens = camera_1280x720();
  const double turning = std::sqrt(turning_radius_sq(lens));
  CHECK(turning > 1);
  CHECK(turning < 1.3);
  const auto slope = [&](double radius) { return project_ray(lens, {radius, 0}).slope(0, 0); };
  CHECK(slope(turning - 0.01) > 0);
  CHECK(slope(turning + 0.01) < 0);
  Lens pinhole = lens;
  pinhole.k1 = pinhole.k2 = pinhole.k3 = 0;
  CHECK(turning_radius_sq(pinhole) == 100);
}

TEST_CASE("lens: every pixel of the image has a ray within the turning radius that leads back to it, or none") {
  for (const auto& [k1, k2, k3] : {std::array{-0.3956, 0.2259, -0.0912}, std::array{0.0, 0.0, 0.0}}) {
    Lens lens = camera_1280x720();
    lens.k1 = k1, lens.k2 = k2, lens.k3 = k3;
    const double turning_sq = turning_radius_sq(lens);
    int without = 0;
    for (int y = 0; y < 720; y += 13) {
      for (int x = 0; x < 1280; x += 17) {
        const Eigen::Vector2d pixel(x, y), ray = ray_from_pixel(lens, pixel, 1e-9);
        if (!ray.allFinite()) {
          ++without;
          continue;
        }
        CHECK(ray.squaredNorm() < turning_sq);
        CHECK((pixel_from_ray(lens, ray) - pixel).norm() < 1e-8);
      }
    }
    CHECK((k1 == 0) == (without == 0));
  }
}

TEST_CASE("lens: refuses what cannot be a lens, naming the field") {
  CHECK_NOTHROW(check_lens(camera_1280x720()));
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto refused = [](auto change, const char* field) {
    Lens lens = camera_1280x720();
    change(lens);
    try {
      check_lens(lens);
      FAIL("accepted a wrong ", field);
    } catch (const InputError& error) {
      CHECK(std::string(error.what()).find(field) != std::string::npos);
    }
  };
  refused([](Lens& c) { c.width_px = 0; }, "width_px");
  refused([](Lens& c) { c.height_px = -720; }, "height_px");
  refused([&](Lens& c) { c.fx = nan; }, "fx");
  refused([](Lens& c) { c.fy = -735; }, "fy");
  refused([](Lens& c) { c.fx = 127; }, "fx");
  refused([](Lens& c) { c.fy = 25601; }, "fy");
  refused([&](Lens& c) { c.cx = nan; }, "cx");
  refused([](Lens& c) { c.cy = 720; }, "cy");
  refused([&](Lens& c) { c.k1 = nan; }, "k1");
  refused([](Lens& c) { c.k3 = std::numeric_limits<double>::infinity(); }, "k3");
}
