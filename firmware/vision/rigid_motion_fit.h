// The one rigid motion that explains all plates at once, which no touch does: what a camera sees that was knocked.
#pragma once

#include "firmware/types.h"
#include "firmware/vision/plate_estimator.h"

namespace finsight {

/// How well one rigid motion of the whole finger explains all corners.
struct RigidMotionFit {
  double size_mm = 0;          ///< length of the 18 numbers (mm, and 28.65 mm per rad): 1 mm per plate is 1.7
  double reprojection_px = 0;  ///< RMS distance of all seen corners from where that motion puts them
  /// Square of the angle (rad) by which they are off on average, less what their scatter makes of it; may be negative.
  double unexplained_sq = 0;
};

class RigidMotionFitter {
 public:
  /// `focal_px` turns angles into pixels.
  RigidMotionFitter(const MountModel& mount, double focal_px);

  /// Least squares over the corners of all seen plates, from where they are at the zero: Gauss-Newton with three steps,
  /// which moves of up to 0.2 rad need. Infinite distances behind the camera. Never allocates.
  RigidMotionFit fit(const PlateSight& sight, const std::array<PlateMotion, kPlates>& zero) const;

 private:
  struct Plate {
    Eigen::Vector3d centre;                 ///< finger frame
    std::array<Eigen::Vector3d, 4> corner;  ///< from the centre
  };
  std::array<Plate, kPlates> plate_;
  Eigen::Isometry3d T_camera_finger_;
  double focal_px_;
};

}  // namespace finsight
