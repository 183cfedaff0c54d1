#include "firmware/loop/marker_places.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>

#include "firmware/geometry/so3.h"
#include "firmware/model/rest_spread.h"

namespace finsight {

namespace {

/// Some fingers are made with more care than others, and the zero shows it: what it leaves open goes with how far the
/// markers are off. So many numbers of a zero weigh as much as the tolerances that the pack states.
constexpr double kCareWeight = 1;

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
    : nominal_(nominal), tolerances_(tolerances), R_nominal_shown_(Eigen::Matrix3f::Identity()) {
  if (measured) {
    by_mount_ = seen_with(nominal, *measured);
    R_nominal_shown_ = nominal.T_finger_camera.linear() * measured->T_finger_camera.linear().transpose();
  }
  forget();
}

void MarkerPlaces::forget() {
  is_estimated_ = false;
  offset_mm_.fill(Vec3f::Zero());
  print_scale_ = 1;
  R_shown_finger_.setIdentity();
  if (by_mount_) estimate({});
}

PoseVectorOf<double> MarkerPlaces::seen_from_nominal(const ZeroPose& zero) const {
  PoseVectorOf<double> shown;
  for (int p = 0; p < kPlates; ++p) {
    const auto plate = static_cast<std::size_t>(p);
    Vec3f displacement_mm = R_nominal_shown_ * zero[plate].displacement_mm;
    Vec3f rotation_rad = R_nominal_shown_ * zero[plate].rotation_rad;
    if (by_mount_) {
      displacement_mm += (*by_mount_)[plate].displacement_mm;
      rotation_rad += (*by_mount_)[plate].rotation_rad;
    }
    shown.segment<6>(6 * p) << displacement_mm.cast<double>(), rotation_rad.cast<double>();
  }
  return shown;
}

// The zero y is the sum of the unknowns' shares, all normal. With its covariance V and that of the unknowns with it, C,
// their mean given y is C V^-1 y, and their covariance falls by C V^-1 C^T.
void MarkerPlaces::estimate(const ZeroPose& zero) {
  using Vector = PoseVectorOf<double>;
  using Matrix = Eigen::Matrix<double, kPoseDims, kPoseDims>;
  constexpr double kSmallest = 1e-6;  // mm and rad: markers that are exactly in place
  const Vector own_variance = own_rest_variance(std::max<double>(tolerances_.marker_tolerance_mm, kSmallest),
                                                std::max<double>(tolerances_.marker_tolerance_rad, kSmallest));
  const auto common = common_rest_spread(nominal_);
  Matrix variance = common * common.transpose();
  variance.diagonal() += own_variance;
  Covariance open = Covariance::Zero();
  Eigen::Matrix<double, kUnknowns, kPoseDims> with_zero = Eigen::Matrix<double, kUnknowns, kPoseDims>::Zero();
  open.diagonal().head<3>().setConstant(kCameraSpread_rad * kCameraSpread_rad);
  with_zero.topRows<3>() = kCameraSpread_rad * common.middleCols<3>(3).transpose();
  open(3, 3) = kPrintSpread * kPrintSpread;
  with_zero.row(3) = kPrintSpread * common.col(6).transpose();
  for (int i = 0; i < 3 * kPlates; ++i) {
    const int of_zero = 6 * (i / 3) + i % 3;
    open(4 + i, 4 + i) = with_zero(4 + i, of_zero) = own_variance[of_zero];
  }
  const Vector shown = seen_from_nominal(zero);
  const Eigen::LLT<Matrix> factor = variance.llt();
  const Vector weighted = factor.solve(shown);
  const Unknowns mean = with_zero * weighted;
  open -= with_zero * factor.solve(with_zero.transpose());
  open *= (kCareWeight + shown.dot(weighted)) / (kCareWeight + kPoseDims);
  R_shown_finger_ = R_nominal_shown_.transpose() * so3_exp(Vec3f(mean.head<3>().cast<float>()));
  print_scale_ = static_cast<float>(1 + mean[3]);
  for (int p = 0; p < kPlates; ++p) {
    offset_mm_[static_cast<std::size_t>(p)] = mean.segment<3>(4 + 3 * p).cast<float>();
  }
  leave_open(open);
  is_estimated_ = true;
}

// The directions of the covariance that move the plates most.
void MarkerPlaces::leave_open(const Covariance& covariance) {
  // Where a plate turns by 0.2 rad and moves by 6 mm, a camera that is off by 1 rad, or a print by all of its size,
  // changes that motion as much as an offset of this.
  constexpr double kOffset_mm = 30;
  Unknowns unit = Unknowns::Ones();
  unit.head<4>().setConstant(kOffset_mm);
  const Eigen::SelfAdjointEigenSolver<Covariance> axes(unit.asDiagonal() * covariance * unit.asDiagonal());
  for (int k = 0; k < kDoubts; ++k) {
    const int largest = kUnknowns - 1 - k;
    const double deviation = std::sqrt(std::max(axes.eigenvalues()[largest], 0.0));
    left_open_.col(k) = (deviation * axes.eigenvectors().col(largest).cwiseQuotient(unit)).cast<float>();
  }
}

void MarkerPlaces::correct(PlatePoses& poses) const {
  for (std::size_t p = 0; p < kPlates; ++p) {
    PlateMotion& plate = poses.plates[p];
    plate.rotation_rad = R_shown_finger_.transpose() * plate.rotation_rad;
    plate.displacement_mm = print_scale_ * (R_shown_finger_.transpose() * plate.displacement_mm);
    plate.displacement_mm -= so3_exp(plate.rotation_rad) * offset_mm_[p] - offset_mm_[p];
  }
}

std::span<const PoseVector> MarkerPlaces::doubts(const PlatePoses& corrected) {
  if (!is_estimated_) return {};
  for (int p = 0; p < kPlates; ++p) {
    const PlateMotion& plate = corrected.plates[static_cast<std::size_t>(p)];
    const Eigen::Matrix3f turned = so3_exp(plate.rotation_rad);
    for (int k = 0; k < kDoubts; ++k) {
      const Vec3f turn = left_open_.block<3, 1>(0, k), offset_mm = left_open_.block<3, 1>(4 + 3 * p, k);
      doubts_[static_cast<std::size_t>(k)].segment<6>(6 * p) << left_open_(3, k) * plate.displacement_mm -
                                                                    turn.cross(plate.displacement_mm) -
                                                                    (turned * offset_mm - offset_mm),
          -turn.cross(plate.rotation_rad);
    }
  }
  return doubts_;
}

}  // namespace finsight
