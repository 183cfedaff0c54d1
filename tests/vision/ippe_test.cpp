#include "firmware/vision/ippe.h"

#include <doctest/doctest.h>

#include <opencv2/calib3d.hpp>

#include "firmware/geometry/so3.h"
#include "tests/vision/test_finger.h"

using namespace finsight;
using namespace finsight::test;

namespace {

MarkerRays rays_of(const Eigen::Isometry3d& T_camera_marker, double size_mm) {
  MarkerRays rays;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d seen = T_camera_marker * finsight::marker_corner(size_mm, k);
    rays[k] = seen.head<2>() / seen.z();
  }
  return rays;
}

Eigen::Isometry3d random_pose(Random& random) {
  const Eigen::Vector3d axis(random.normal(), random.normal(), random.normal());
  return Eigen::Translation3d(random.uniform(-20, 20), random.uniform(-20, 20), random.uniform(60, 120)) *
         Eigen::AngleAxisd(random.uniform(0.1, 0.7), axis.normalized()) *
         Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitX());
}

}  // namespace

TEST_CASE("square: the true pose comes first, and the mirror pose is at the same position") {
  Random random(1);
  for (int i = 0; i < 100; ++i) {
    const Eigen::Isometry3d truth = random_pose(random);
    const SquarePoses poses = poses_of_square(rays_of(truth, 8), 8);
    REQUIRE(poses.count >= 1);
    CHECK((poses.T_camera_marker[0].matrix() - truth.matrix()).cwiseAbs().maxCoeff() < 1e-5);
    if (poses.count == 2) {
      CHECK((poses.T_camera_marker[1].translation() - truth.translation()).norm() < 3);
    }
  }
}

TEST_CASE("square: noisy corners give the same two poses as OpenCV's IPPE") {
  Random random(2);
  for (int i = 0; i < 100; ++i) {
    MarkerRays rays = rays_of(random_pose(random), 8);
    for (Eigen::Vector2d& ray : rays) ray += 2e-4 * Eigen::Vector2d(random.normal(), random.normal());
    std::vector<cv::Point3d> corners;
    std::vector<cv::Point2d> seen;
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d corner = finsight::marker_corner(8, k);
      corners.emplace_back(corner.x(), corner.y(), corner.z());
      seen.emplace_back(rays[k].x(), rays[k].y());
    }
    std::vector<cv::Mat> rotations, translations;
    cv::solvePnPGeneric(corners, seen, cv::Matx33d::eye(), cv::noArray(), rotations, translations, false,
                        cv::SOLVEPNP_IPPE_SQUARE);
    const SquarePoses poses = poses_of_square(rays, 8);
    REQUIRE(poses.count == 2);
    REQUIRE(rotations.size() == 2);
    for (std::size_t s = 0; s < 2; ++s) {
      const Eigen::Vector3d turn(rotations[s].ptr<double>()), shift(translations[s].ptr<double>());
      const Eigen::Matrix3d expected = so3_exp(turn);
      CHECK((poses.T_camera_marker[s].linear() - expected).cwiseAbs().maxCoeff() < 1e-3);
      CHECK((poses.T_camera_marker[s].translation() - shift).norm() < 1e-2);
    }
  }
}

TEST_CASE("square: a square seen exactly face-on has a pose, too") {
  for (const double x : {0.0, 5.0, -12.5}) {
    Eigen::Isometry3d truth(Eigen::Translation3d(x, 3, 110));
    truth.linear().diagonal() << 1, -1, -1;
    const SquarePoses poses = poses_of_square(rays_of(truth, 8), 8);
    REQUIRE(poses.count >= 1);
    CHECK((poses.T_camera_marker[0].matrix() - truth.matrix()).cwiseAbs().maxCoeff() < 1e-5);
  }
}

TEST_CASE("square: rays that fit no square give no pose and no exception") {
  MarkerRays rays;
  rays.fill(Eigen::Vector2d::Constant(std::nan("")));
  CHECK(poses_of_square(rays, 8).count == 0);
  rays.fill(Eigen::Vector2d::Zero());
  CHECK(poses_of_square(rays, 8).count == 0);
  for (std::size_t k = 0; k < 4; ++k) rays[k] = Eigen::Vector2d(0.1 * static_cast<double>(k), 0);  // on one line
  CHECK(poses_of_square(rays, 8).count == 0);
}
