#include "firmware/vision/mount_check.h"

#include <Eigen/QR>
#include <algorithm>

#include "firmware/plate_motion.h"

namespace finsight {
namespace {

Eigen::Matrix<double, 18, 1> scaled_numbers(const PlatePoses& poses) {
  Eigen::Matrix<double, 18, 1> numbers;
  for (int p = 0; p < kPlates; ++p) {
    numbers.segment<3>(6 * p) = poses.plates[p].displacement_mm.cast<double>();
    numbers.segment<3>(6 * p + 3) =
        static_cast<double>(kMillimetresPerRadian) * poses.plates[p].rotation_rad.cast<double>();
  }
  return numbers;
}

}  // namespace

// A small rigid motion (t, w) moves a plate at c by t + w x c and turns it by w. Its 18 numbers span six dimensions;
// bent_ projects on the other twelve.
MountCheck::MountCheck(const MountModel& mount) {
  Eigen::Matrix<double, 18, 6> rigid = Eigen::Matrix<double, 18, 6>::Zero();
  for (int p = 0; p < kPlates; ++p) {
    const Eigen::Vector3d c = mount.T_finger_marker[static_cast<std::size_t>(p)].translation().cast<double>();
    rigid.block<3, 3>(6 * p, 0).setIdentity();
    for (int axis = 0; axis < 3; ++axis) {
      rigid.block<3, 1>(6 * p, 3 + axis) = Eigen::Vector3d::Unit(axis).cross(c);
    }
    rigid.block<3, 3>(6 * p + 3, 3) = static_cast<double>(kMillimetresPerRadian) * Eigen::Matrix3d::Identity();
  }
  const Eigen::HouseholderQR<Eigen::Matrix<double, 18, 6>> qr(rigid);
  const Eigen::Matrix<double, 18, 6> basis = qr.householderQ() * Eigen::Matrix<double, 18, 6>::Identity();
  bent_ = Eigen::Matrix<double, 18, 18>::Identity() - basis * basis.transpose();
}

bool MountCheck::look(const PlatePoses& poses) {
  if (poses.quality != Quality::kFresh || poses.seen_count() < kPlates) return knocked_;
  const Eigen::Matrix<double, 18, 1> numbers = scaled_numbers(poses);
  bool moves = false;
  for (int p = 0; p < kPlates && frames_ > 0; ++p) {
    const double off_mm = (numbers - mean_).segment<3>(6 * p).norm();
    moves |= !(off_mm <= static_cast<double>(kStill_mm));
  }
  moving_ = moves ? moving_ + 1 : 0;
  if (moves && moving_ < kBrief) return knocked_;
  if (moves) frames_ = moving_ = 0;
  if (frames_ == 0) mean_.setZero();
  frames_ = std::min(frames_ + 1, kFrames);
  mean_ += (numbers - mean_) / frames_;
  if (frames_ < kFrames) return knocked_;
  const double size_mm = mean_.norm();
  knocked_ = size_mm > kKnocked_mm && (bent_ * mean_).norm() < kLargestRest * size_mm;
  return knocked_;
}

}  // namespace finsight
