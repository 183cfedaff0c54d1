#include "hostgen/render/lens.h"

#include <doctest/doctest.h>

#include <opencv2/calib3d.hpp>

#include "hostgen/util/random.h"

using namespace finsight::host;

namespace {

CameraIntrinsics default_camera() {
  return {.width_px = 1280,
          .height_px = 720,
          .fx = 736.05,
          .fy = 735.90,
          .cx = 615.63,
          .cy = 365.71,
          .k1 = -0.3956,
          .k2 = 0.2259,
          .p1 = 0,
          .p2 = 0,
          .k3 = -0.0912};
}

Eigen::Vector2d projected_by_opencv(const CameraIntrinsics& c, const Eigen::Vector2d& ray) {
  const cv::Matx33d matrix(c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1);
  const std::vector<double> distortion{c.k1, c.k2, c.p1, c.p2, c.k3};
  std::vector<cv::Point2d> pixels;
  cv::projectPoints(std::vector{cv::Point3d(ray.x(), ray.y(), 1)}, cv::Vec3d(), cv::Vec3d(), matrix, distortion,
                    pixels);
  return {pixels[0].x, pixels[0].y};
}

}  // namespace

TEST_CASE("lens: rays land where OpenCV's projectPoints puts them, and come back") {
  CameraIntrinsics tangential = default_camera();
  tangential.p1 = 0.003;
  tangential.p2 = -0.002;
  CameraIntrinsics pincushion = default_camera();
  pincushion.k1 = 0.15;
  pincushion.k2 = pincushion.k3 = 0;
  Random random(1);
  for (const CameraIntrinsics& camera : {default_camera(), tangential, pincushion}) {
    const Lens lens(camera);
    double worst_px = 0, worst_back = 0;
    int seen = 0;
    for (int i = 0; i < 2000; ++i) {
      const Eigen::Vector2d ray(random.uniform(-1, 1), random.uniform(-0.6, 0.6));
      if (ray.norm() > 1) continue;
      const auto pixel = lens.pixel(ray);
      REQUIRE(pixel);
      ++seen;
      worst_px = std::max(worst_px, (*pixel - projected_by_opencv(camera, ray)).norm());
      const auto back = lens.ray(*pixel);
      REQUIRE(back);
      worst_back = std::max(worst_back, (*back - ray).norm());
    }
    CHECK(seen > 1500);
    CHECK(worst_px < 1e-9);
    CHECK(worst_back < 1e-8);
  }
}

TEST_CASE("lens: where the distortion turns back there is neither pixel nor ray") {
  const Lens lens(default_camera());
  CHECK(lens.pixel({1.0, 0}));
  CHECK_FALSE(lens.pixel({1.3, 0}));  // OpenCV would fold this ray back into the image
  CHECK_FALSE(lens.pixel({1e6, 1e6}));
  CHECK_FALSE(lens.pixel({std::nan(""), 0}));
  CHECK(lens.ray({1000, 365}));
  CHECK_FALSE(lens.ray({1279, 719}));
  CHECK_FALSE(lens.ray({std::nan(""), 0}));
}

TEST_CASE("lens: every pixel of the image has a ray that leads back to it, or none") {
  for (const auto& [k1, k2, k3] : {std::array{-0.3956, 0.2259, -0.0912}, std::array{0.0, 0.0, 0.0}}) {
    CameraIntrinsics camera = default_camera();
    camera.k1 = k1, camera.k2 = k2, camera.k3 = k3;
    const Lens lens(camera);
    int without = 0;
    double worst_px = 0;
    for (int y = 0; y < 720; y += 13) {
      for (int x = 0; x < 1280; x += 17) {
        const Eigen::Vector2d pixel(x, y);
        const auto ray = lens.ray(pixel);
        if (!ray) ++without;
        if (ray) worst_px = std::max(worst_px, (lens.pixel(*ray).value() - pixel).norm());
      }
    }
    CHECK(worst_px < 1e-5);
    CHECK((k1 == 0) == (without == 0));
  }
}
