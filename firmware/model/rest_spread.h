// How markers of the same finger, mounted once more, stand from the model's rest while nothing touches the finger.
#pragma once

#include "firmware/geometry/so3.h"
#include "firmware/model/model.h"

namespace finsight {

inline constexpr double kCameraSpread_mm = 1, kCameraSpread_rad = 0.026;
inline constexpr double kPrintSpread = 0.01;      ///< of the markers' size, relative
inline constexpr double kCommonTilt_rad = 0.015;  ///< of markers that were all stuck on with the same tilt

/// What moves all markers alike: the camera by 1 mm along and 1.5 degrees about each axis; markers that were printed
/// too large by 1 %, which look nearer; and those that are all tilted alike. Columns are standard deviations, in the
/// order of PoseVector (mm and rad).
inline Eigen::Matrix<double, kPoseDims, 10> common_rest_spread(const MountModel& mount) {
  Eigen::Matrix<double, kPoseDims, 10> spread = Eigen::Matrix<double, kPoseDims, 10>::Zero();
  for (int p = 0; p < kPlates; ++p) {
    const Eigen::Vector3d from_camera =
        (mount.T_finger_marker[static_cast<std::size_t>(p)].translation() - mount.T_finger_camera.translation())
            .cast<double>();
    spread.block<3, 3>(6 * p, 0) = kCameraSpread_mm * Eigen::Matrix3d::Identity();
    spread.block<3, 3>(6 * p, 3) = -kCameraSpread_rad * cross_matrix(from_camera);
    spread.block<3, 3>(6 * p + 3, 3) = kCameraSpread_rad * Eigen::Matrix3d::Identity();
    spread.block<3, 1>(6 * p, 6) = -kPrintSpread * from_camera;
    spread.block<3, 3>(6 * p + 3, 7) = kCommonTilt_rad * Eigen::Matrix3d::Identity();
  }
  return spread;
}

/// Variances of what moves each marker by itself, besides: `mm` along and `rad` about each axis.
inline PoseVectorOf<double> own_rest_variance(double mm, double rad) {
  PoseVectorOf<double> variance;
  for (int i = 0; i < kPoseDims; ++i) variance[i] = i % 6 < 3 ? mm * mm : rad * rad;
  return variance;
}

}  // namespace finsight
