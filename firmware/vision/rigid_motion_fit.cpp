#include "firmware/vision/rigid_motion_fit.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>

#include "firmware/geometry/plate_motion.h"
#include "firmware/geometry/so3.h"

namespace finsight {

namespace {

using Eigen::Vector3d;

constexpr int kNewtonSteps = 3;
constexpr double kInfinity = std::numeric_limits<double>::infinity();

}  // namespace

RigidMotionFitter::RigidMotionFitter(const MountModel& mount, double focal_px)
    : T_camera_finger_(mount.T_finger_camera.cast<double>().inverse()), focal_px_(focal_px) {
  for (std::size_t p = 0; p < kPlates; ++p) {
    const Eigen::Isometry3d T_finger_marker = mount.T_finger_marker[p].cast<double>();
    plate_[p].centre = T_finger_marker.translation();
    for (std::size_t k = 0; k < 4; ++k) {
      plate_[p].corner[k] = T_finger_marker.linear() * marker_corner(mount.marker_size_mm, k);
    }
  }
}

// A point that is at X with the zero is now at R X + t. Another dw and dt move it by dw x R X + dt; the camera sees
// where it is along (x / z, y / z).
RigidMotionFit RigidMotionFitter::fit(const PlateSight& sight, const ZeroPose& zero) const {
  std::array<std::array<Vector3d, 4>, kPlates> at_zero;
  for (std::size_t p = 0; p < kPlates; ++p) {
    const Eigen::Matrix3d R = so3_exp(zero[p].rotation_rad.cast<double>());
    for (std::size_t k = 0; k < 4; ++k) {
      at_zero[p][k] = R * plate_[p].corner[k] + plate_[p].centre + zero[p].displacement_mm.cast<double>();
    }
  }
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  Vector3d t = Vector3d::Zero();
  double sum_sq = 0, corners = 0;
  for (int step = 0; step <= kNewtonSteps; ++step) {  // the last one only measures
    Eigen::Matrix<double, 6, 6> information = Eigen::Matrix<double, 6, 6>::Zero();
    Eigen::Matrix<double, 6, 1> gradient = Eigen::Matrix<double, 6, 1>::Zero();
    sum_sq = corners = 0;
    for (std::size_t p = 0; p < kPlates; ++p) {
      for (std::size_t k = 0; k < 4 && sight.seen[p]; ++k) {
        const Vector3d turned = R * at_zero[p][k], seen = T_camera_finger_ * (turned + t);
        if (!(seen.z() > kNearestMm)) return {0, kInfinity, kInfinity};
        const Eigen::Vector2d ray = seen.head<2>() / seen.z(), residual = focal_px_ * (ray - sight.rays[p][k]);
        Eigen::Matrix<double, 2, 3> by_place;
        by_place << 1, 0, -ray.x(), 0, 1, -ray.y();
        by_place = (focal_px_ / seen.z() * by_place * T_camera_finger_.linear()).eval();
        Eigen::Matrix<double, 2, 6> jacobian;
        jacobian.leftCols<3>() = by_place;
        jacobian.rightCols<3>() = -by_place * cross_matrix(turned);
        information.noalias() += jacobian.transpose() * jacobian;
        gradient.noalias() += jacobian.transpose() * residual;
        sum_sq += residual.squaredNorm();
        ++corners;
      }
    }
    if (step == kNewtonSteps) break;
    const Eigen::Matrix<double, 6, 1> move = information.ldlt().solve(gradient);
    t -= move.head<3>();
    R = so3_exp(-move.tail<3>()) * R;
  }
  const double angle_rad = so3_log(R).norm();
  double size_sq = 0;
  for (std::size_t p = 0; p < kPlates; ++p) {
    const Vector3d centre = plate_[p].centre + zero[p].displacement_mm.cast<double>();
    size_sq += (R * centre + t - centre).squaredNorm() + std::pow(kMillimetresPerRadian * angle_rad, 2);
  }
  if (!std::isfinite(sum_sq / corners) || !std::isfinite(size_sq)) return {0, kInfinity, kInfinity};
  // Of two numbers per corner the motion takes six up.
  const double scatter_sq = std::pow(sight.corner_sigma_px, 2) * (2 * corners - 6) / corners;
  return {std::sqrt(size_sq), std::sqrt(sum_sq / corners), (sum_sq / corners - scatter_sq) / (focal_px_ * focal_px_)};
}

}  // namespace finsight
