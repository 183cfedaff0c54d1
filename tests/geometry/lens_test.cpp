#include "firmware/geometry/lens.h"

#include <doctest/doctest.h>

#include <limits>
#include <opencv2/calib3d.hpp>

#include "firmware/input_error.h"
#include "tests/vision/test_finger.h"

using namespace finsight;
using namespace finsight::test;

namespace {

CameraModel tangential_camera() {
  CameraModel camera = camera_1280x720();
  camera.p1 = 0.004F;
  camera.p2 = -0.003F;
  return camera;
}

}  // namespace

TEST_CASE("camera: projects like OpenCV's projectPoints") {
  const CameraModel camera = tangential_camera();
  Random random(1);
  for (int i = 0; i < 200; ++i) {
    const Eigen::Vector2d ray(random.uniform(-0.7, 0.7), random.uniform(-0.5, 0.5));
    std::vector<cv::Point2d> expected;
    const cv::Matx33d intrinsic(camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1);
    const cv::Matx<double, 1, 5> lens(camera.k1, camera.k2, camera.p1, camera.p2, camera.k3);
    cv::projectPoints(std::vector<cv::Point3d>{{3 * ray.x(), 3 * ray.y(), 3}}, cv::Vec3d::all(0), cv::Vec3d::all(0),
                      intrinsic, lens, expected);
    const Eigen::Vector2d found = pixel_from_ray(camera, ray);
    CHECK(found.x() == doctest::Approx(expected[0].x).epsilon(1e-9));
    CHECK(found.y() == doctest::Approx(expected[0].y).epsilon(1e-9));
  }
}

TEST_CASE("camera: the slope of the projection is its finite difference") {
  const CameraModel camera = tangential_camera();
  const Eigen::Vector2d ray(0.41, -0.33);
  const Projection projection = project_ray(camera, ray);
  constexpr double kStep = 1e-6;
  for (int axis = 0; axis < 2; ++axis) {
    const Eigen::Vector2d step = kStep * Eigen::Vector2d::Unit(axis);
    const Eigen::Vector2d slope =
        (pixel_from_ray(camera, ray + step) - pixel_from_ray(camera, ray - step)) / (2 * kStep);
    CHECK((projection.slope.col(axis) - slope).norm() < 1e-4);
  }
}

TEST_CASE("camera: pixel to ray and back is the same pixel, up to where the lens model folds over") {
  for (const CameraModel& camera : {camera_1280x720(), camera_640x480(), tangential_camera()}) {
    for (double angle = 0; angle < 6.3; angle += 0.1) {
      for (double share = 0; share <= 0.74; share += 0.02) {  // these coefficients fold at 0.76 focal lengths
        const Eigen::Vector2d pixel(camera.cx + share * camera.fx * std::cos(angle),
                                    camera.cy + share * camera.fy * std::sin(angle));
        CHECK((pixel_from_ray(camera, ray_from_pixel(camera, pixel)) - pixel).norm() < 1e-5);
      }
    }
  }
}

TEST_CASE("camera: where the lens model has no inverse there is no ray") {
  CHECK(!ray_from_pixel(camera_1280x720(), {3000, 365}).allFinite());
  CHECK(!ray_from_pixel(camera_1280x720(), {std::nan(""), 365}).allFinite());
}

TEST_CASE("camera: refuses what cannot be a camera, naming the field") {
  CHECK_NOTHROW(check_camera(camera_1280x720()));
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const auto refused = [](auto change, const char* field) {
    CameraModel camera = camera_1280x720();
    change(camera);
    try {
      check_camera(camera);
      FAIL("accepted a wrong ", field);
    } catch (const InputError& error) {
      CHECK(std::string(error.what()).find(field) != std::string::npos);
    }
  };
  refused([](CameraModel& c) { c.width_px = 0; }, "width_px");
  refused([](CameraModel& c) { c.height_px = -720; }, "height_px");
  refused([&](CameraModel& c) { c.fx = nan; }, "fx");
  refused([](CameraModel& c) { c.fy = -735; }, "fy");
  refused([&](CameraModel& c) { c.cx = nan; }, "cx");
  refused([](CameraModel& c) { c.cy = 720; }, "cy");
  refused([&](CameraModel& c) { c.k1 = nan; }, "k1");
  refused([](CameraModel& c) { c.k3 = std::numeric_limits<float>::infinity(); }, "k3");
}
