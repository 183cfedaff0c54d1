// v   ray of the marker's centre; J  the Jacobian there of the homography from the marker's plane to the rays
// Rv  rotation that takes the z axis onto (v, 1)
// A   J as seen along that ray; gamma  its larger singular value; R  T_camera_marker's rotation
// (section 4 of the paper, with its letters)
#include "firmware/vision/ippe.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

namespace finsight {
namespace {

using Eigen::Matrix2d;
using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

/// Where the homography takes the marker's centre, and its Jacobian there. In closed form for a square (Heckbert 1989):
/// a to the right and b downwards run from 0 to 1, (a, b) -> ((h + a hx + b hy) / (1 + a g + b k)).
struct CentreMap {
  Vector2d v;
  Matrix2d J;
};

CentreMap map_of_centre(const MarkerRays& q, double size_mm) {
  const Vector2d d1 = q[1] - q[2], d2 = q[3] - q[2], s = q[0] - q[1] + q[2] - q[3];
  const double determinant = d1.x() * d2.y() - d2.x() * d1.y();
  const double g = (s.x() * d2.y() - d2.x() * s.y()) / determinant;
  const double k = (d1.x() * s.y() - s.x() * d1.y()) / determinant;
  const Vector2d hx = q[1] - q[0] + g * q[1], hy = q[3] - q[0] + k * q[3];
  const double w = 1 + (g + k) / 2;
  CentreMap map;
  map.v = (q[0] + (hx + hy) / 2) / w;
  map.J.col(0) = (hx - g * map.v) / (w * size_mm);
  map.J.col(1) = -(hy - k * map.v) / (w * size_mm);  // the marker's y axis points up
  return map;
}

/// The shortest rotation that takes the z axis to the direction of (v, 1).
Matrix3d rotation_to(const Vector2d& v) {
  const double length = std::sqrt(1 + v.squaredNorm());
  Matrix3d R;
  R.topLeftCorner<2, 2>() = Matrix2d::Identity() - v * v.transpose() / (length * (length + 1));
  R.topRightCorner<2, 1>() = v / length;
  R.bottomLeftCorner<1, 2>() = -v.transpose() / length;
  R(2, 2) = 1 / length;
  return R;
}

/// Where a square turned by R must be: least squares of x - u z = 0 and y - v z = 0 over its corners.
Vector3d translation(const MarkerRays& rays, double size_mm, const Matrix3d& R) {
  Matrix3d normal = Matrix3d::Zero();
  Vector3d right = Vector3d::Zero();
  for (std::size_t k = 0; k < 4; ++k) {
    Eigen::Matrix<double, 2, 3> across;
    across << 1, 0, -rays[k].x(), 0, 1, -rays[k].y();
    normal += across.transpose() * across;
    right -= across.transpose() * (across * (R * marker_corner(size_mm, k)));
  }
  return normal.inverse() * right;
}

double squared_error(const MarkerRays& rays, double size_mm, const Eigen::Isometry3d& pose) {
  double sum = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    const Vector3d seen = pose * marker_corner(size_mm, k);
    sum += (seen.head<2>() / seen.z() - rays[k]).squaredNorm();
  }
  return sum;
}

}  // namespace

Vector3d marker_corner(double size_mm, std::size_t corner) {
  const bool right = corner == 1 || corner == 2, upper = corner < 2;
  return {(right ? 0.5 : -0.5) * size_mm, (upper ? 0.5 : -0.5) * size_mm, 0};
}

SquarePoses poses_of_square(const MarkerRays& rays, double size_mm) {
  const auto [v, J] = map_of_centre(rays, size_mm);
  const Matrix3d Rv = rotation_to(v);
  Eigen::Matrix<double, 2, 3> across;
  across << 1, 0, -v.x(), 0, 1, -v.y();
  const Matrix2d B = across * Rv.leftCols<2>();
  const Matrix2d A = B.inverse() * J;
  const Matrix2d AAt = A * A.transpose();
  const double gamma = std::sqrt(0.5 * (AAt.trace() + std::hypot(AAt(0, 0) - AAt(1, 1), 2 * AAt(0, 1))));
  const Matrix2d r = A / gamma;  // upper left of the rotation; its columns are completed to unit length, ...
  Vector2d b(std::sqrt(std::max(0.0, 1 - r.col(0).squaredNorm())),
             std::sqrt(std::max(0.0, 1 - r.col(1).squaredNorm())));
  if (r.col(0).dot(r.col(1)) > 0) b[1] = -b[1];  // ... perpendicular, in either of two ways

  SquarePoses poses;
  for (const double sign : {1.0, -1.0}) {
    Matrix3d R;
    R.col(0) << r.col(0), sign * b[0];
    R.col(1) << r.col(1), sign * b[1];
    R.col(2) = R.col(0).cross(R.col(1));
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.linear() = Rv * R;
    pose.translation() = translation(rays, size_mm, pose.linear());
    if (!pose.matrix().allFinite() || !(pose.translation().z() > size_mm)) continue;
    poses.T_camera_marker[static_cast<std::size_t>(poses.count++)] = pose;
  }
  auto& [first, second] = poses.T_camera_marker;
  if (poses.count == 2 && squared_error(rays, size_mm, second) < squared_error(rays, size_mm, first)) {
    std::swap(first, second);
  }
  return poses;
}

}  // namespace finsight
