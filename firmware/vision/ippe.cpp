#include "firmware/vision/ippe.h"

#include <exception>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <vector>

namespace finsight {

Eigen::Vector3d marker_corner(double size_mm, std::size_t corner) {
  const bool right = corner == 1 || corner == 2, upper = corner < 2;
  return {(right ? 0.5 : -0.5) * size_mm, (upper ? 0.5 : -0.5) * size_mm, 0};
}

namespace {

SquarePoses opencv_ippe(const MarkerRays& rays, double size_mm) {
  SquarePoses poses;
  std::array<cv::Point3d, 4> corners;
  std::array<cv::Point2d, 4> seen;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d corner = marker_corner(size_mm, k);
    corners[k] = {corner.x(), corner.y(), corner.z()};
    seen[k] = {rays[k].x(), rays[k].y()};
  }
  std::vector<cv::Mat> rotations, translations;
  cv::solvePnPGeneric(corners, seen, cv::Matx33d::eye(), cv::noArray(), rotations, translations, false,
                      cv::SOLVEPNP_IPPE_SQUARE);
  for (std::size_t i = 0; i < rotations.size() && i < 2; ++i) {
    const Eigen::Vector3d turn(rotations[i].ptr<double>()), shift(translations[i].ptr<double>());
    const double angle = turn.norm();
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    if (angle > 0) pose.linear() = Eigen::AngleAxisd(angle, turn / angle).toRotationMatrix();
    pose.translation() = shift;
    if (!pose.matrix().allFinite() || !(shift.z() > size_mm)) continue;
    poses.T_camera_marker[static_cast<std::size_t>(poses.count++)] = pose;
  }
  return poses;
}

}  // namespace

SquarePoses poses_of_square(const MarkerRays& rays, double size_mm) {
  for (const Eigen::Vector2d& ray : rays) {
    if (!ray.allFinite()) return {};
  }
  try {
    SquarePoses poses = opencv_ippe(rays, size_mm);
    if (poses.count > 0) return poses;
    // Of a square seen exactly face-on, rounding makes OpenCV take the root of a tiny negative number. A thousandth of
    // a pixel away from there it does not.
    MarkerRays nudged = rays;
    nudged[0] += 1e-5 * (rays[0] - rays[2]);
    return opencv_ippe(nudged, size_mm);
  } catch (const std::exception&) {
    return {};
  }
}

}  // namespace finsight
