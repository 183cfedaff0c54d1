// How the camera is turned against the finger, where on its plate each marker sits, and how large the markers are, from
// how they stand when nothing touches the finger.
#pragma once

#include <array>
#include <optional>
#include <span>

#include "firmware/model/model.h"

namespace finsight {

/// Markers are stuck on by hand. A zero takes their offset out of the plates' motion, except that a marker beside its
/// place shows the motion of that place: turned by R, it moves by (R - 1) times its offset more than the plate's own.
/// Markers that a printer made smaller seem further away, and their motions larger, by as much; a camera that is turned
/// against the finger sees all motions turned.
class MarkerPlaces {
 public:
  static constexpr int kDoubts = 6;

  /// `measured`: this device's mount where it was measured, which shows what a zero shows.
  MarkerPlaces(const MountModel& nominal, const std::optional<MountModel>& measured, const TouchModel& tolerances);

  /// The most probable camera, print and offsets: what the zero shows is one motion of the camera against the finger
  /// (standard deviations 1 mm and 1.5 degrees), a print that is too large or small (1 %), markers that are all tilted
  /// alike, and, besides, the markers' own offsets by the pack's tolerance.
  void estimate(const ZeroPose& zero);
  void forget();

  /// Makes motions that markers show, relative to the zero, those of the plates.
  void correct(PlatePoses& poses) const;
  /// What the zero leaves open, as changes of corrected motions: each of these by one standard deviation,
  /// independently. None without a zero or a measured mount.
  std::span<const PoseVector> doubts(const PlatePoses& corrected);

  const std::array<Vec3f, kPlates>& offset_mm() const { return offset_mm_; }
  const Eigen::Matrix3f& R_shown_finger() const { return R_shown_finger_; }
  float print_scale() const { return print_scale_; }  ///< of all markers, over their nominal size

 private:
  /// Rotation vector of the camera against the finger, print, and the markers' offsets.
  static constexpr int kUnknowns = 3 + 1 + 3 * kPlates;
  using Unknowns = Eigen::Matrix<double, kUnknowns, 1>;
  using Covariance = Eigen::Matrix<double, kUnknowns, kUnknowns>;
  PoseVectorOf<double> seen_from_nominal(const ZeroPose& zero) const;
  void leave_open(const Covariance& covariance);

  const MountModel& nominal_;
  const TouchModel& tolerances_;
  std::optional<ZeroPose> by_mount_;  ///< the zero that the nominal mount would have shown
  Eigen::Matrix3f R_nominal_shown_;   ///< the frame of the poses, seen from that of the nominal mount
  bool is_estimated_ = false;
  std::array<Vec3f, kPlates> offset_mm_;
  float print_scale_ = 1;
  Eigen::Matrix3f R_shown_finger_;  ///< how the finger is turned where the poses are measured
  Eigen::Matrix<float, kUnknowns, kDoubts> left_open_;
  std::array<PoseVector, kDoubts> doubts_;
};

}  // namespace finsight
