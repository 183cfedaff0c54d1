#include "firmware/loop/marker_places.h"

#include <Eigen/Cholesky>
#include <algorithm>

#include "firmware/geometry/so3.h"

namespace finsight {

namespace {

constexpr double kMount_mm = 1, kMount_rad = 0.026;

}  // namespace

// The zero y is A m + s, with the camera's six numbers m and the markers' s. Given y, the mean of s is
// S (S + A M A^T)^-1 y.
void MarkerPlaces::estimate(const ZeroPose& zero) {
  using Vector = PoseVectorOf<double>;
  using Matrix = Eigen::Matrix<double, kPoseDims, kPoseDims>;
  constexpr double kSmallest = 1e-6;  // mm and rad: markers that are exactly in place
  Vector shown, own_variance;
  Eigen::Matrix<double, kPoseDims, 6> by_mount = Eigen::Matrix<double, kPoseDims, 6>::Zero();
  const double mm = std::max<double>(tolerances_.marker_tolerance_mm, kSmallest),
               rad = std::max<double>(tolerances_.marker_tolerance_rad, kSmallest);
  for (int p = 0; p < kPlates; ++p) {
    const auto plate = static_cast<std::size_t>(p);
    const Vec3f from_camera = mount_.T_finger_marker[plate].translation() - mount_.T_finger_camera.translation();
    shown.segment<6>(6 * p) << zero[plate].displacement_mm.cast<double>(), zero[plate].rotation_rad.cast<double>();
    own_variance.segment<6>(6 * p) << mm * mm, mm * mm, mm * mm, rad * rad, rad * rad, rad * rad;
    by_mount.block<3, 3>(6 * p, 0) = kMount_mm * Eigen::Matrix3d::Identity();
    by_mount.block<3, 3>(6 * p, 3) = -kMount_rad * cross_matrix(from_camera.cast<double>());
    by_mount.block<3, 3>(6 * p + 3, 3) = kMount_rad * Eigen::Matrix3d::Identity();
  }
  Matrix variance = by_mount * by_mount.transpose();
  variance.diagonal() += own_variance;
  const Vector own = own_variance.cwiseProduct(variance.llt().solve(shown));
  for (int p = 0; p < kPlates; ++p) offset_mm_[static_cast<std::size_t>(p)] = own.segment<3>(6 * p).cast<float>();
}

void MarkerPlaces::correct(PlatePoses& poses) const {
  for (std::size_t p = 0; p < kPlates; ++p) {
    PlateMotion& plate = poses.plates[p];
    plate.displacement_mm -= so3_exp(plate.rotation_rad) * offset_mm_[p] - offset_mm_[p];
  }
}

}  // namespace finsight
