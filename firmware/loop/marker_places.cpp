#include "firmware/loop/marker_places.h"

#include <Eigen/Cholesky>
#include <algorithm>

#include "firmware/geometry/so3.h"
#include "firmware/model/rest_spread.h"

namespace finsight {

namespace {

/// Where the nominal mount would see the markers that a measured mount sees at rest.
ZeroPose seen_with(const MountModel& nominal, const MountModel& measured) {
  const Eigen::Isometry3f T = nominal.T_finger_camera * measured.T_finger_camera.inverse();
  ZeroPose seen;
  for (std::size_t p = 0; p < kPlates; ++p) {
    const Eigen::Isometry3f T_finger_marker = T * measured.T_finger_marker[p];
    seen[p].displacement_mm = T_finger_marker.translation() - nominal.T_finger_marker[p].translation();
    const Eigen::Matrix3f turned = T_finger_marker.linear() * nominal.T_finger_marker[p].linear().transpose();
    seen[p].rotation_rad = so3_log(turned);
  }
  return seen;
}

}  // namespace

MarkerPlaces::MarkerPlaces(const MountModel& nominal, const std::optional<MountModel>& measured,
                           const TouchModel& tolerances)
    : nominal_(nominal), tolerances_(tolerances) {
  if (measured) by_mount_ = seen_with(nominal, *measured);
  forget();
}

void MarkerPlaces::forget() {
  offset_mm_.fill(Vec3f::Zero());
  print_scale_ = 1;
  if (by_mount_) estimate({});
}

// The zero y is A m + s, with the camera's six numbers and the print's size in m, and the markers' offsets in s. Given
// y, the mean of s is S (S + A M A^T)^-1 y, that of m is M A^T (S + A M A^T)^-1 y.
void MarkerPlaces::estimate(const ZeroPose& zero) {
  using Vector = PoseVectorOf<double>;
  using Matrix = Eigen::Matrix<double, kPoseDims, kPoseDims>;
  constexpr double kSmallest = 1e-6;  // mm and rad: markers that are exactly in place
  Vector shown;
  for (int p = 0; p < kPlates; ++p) {
    const auto plate = static_cast<std::size_t>(p);
    shown.segment<6>(6 * p) << zero[plate].displacement_mm.cast<double>(), zero[plate].rotation_rad.cast<double>();
    if (!by_mount_) continue;
    shown.segment<3>(6 * p) += (*by_mount_)[plate].displacement_mm.cast<double>();
    shown.segment<3>(6 * p + 3) += (*by_mount_)[plate].rotation_rad.cast<double>();
  }
  const Vector own_variance = own_rest_variance(std::max<double>(tolerances_.marker_tolerance_mm, kSmallest),
                                                std::max<double>(tolerances_.marker_tolerance_rad, kSmallest));
  const Eigen::Matrix<double, kPoseDims, 7> common = common_rest_spread(nominal_);
  Matrix variance = common * common.transpose();
  variance.diagonal() += own_variance;
  const Vector weighted = variance.llt().solve(shown), own = own_variance.cwiseProduct(weighted);
  for (int p = 0; p < kPlates; ++p) offset_mm_[static_cast<std::size_t>(p)] = own.segment<3>(6 * p).cast<float>();
  print_scale_ = static_cast<float>(1 + kPrintSpread * common.col(6).dot(weighted));
}

void MarkerPlaces::correct(PlatePoses& poses) const {
  for (std::size_t p = 0; p < kPlates; ++p) {
    PlateMotion& plate = poses.plates[p];
    plate.displacement_mm *= print_scale_;
    plate.displacement_mm -= so3_exp(plate.rotation_rad) * offset_mm_[p] - offset_mm_[p];
  }
}

}  // namespace finsight
