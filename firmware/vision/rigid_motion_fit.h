// The one rigid motion of the whole finger that explains all plates at once. No touch causes one: it is what a camera
// sees that was knocked.
#pragma once

#include "firmware/types.h"
#include "firmware/vision/plate_estimator.h"

namespace finsight {

class RigidMotionFitter {
 public:
  /// `focal_px` turns angles into pixels.
  RigidMotionFitter(const MountModel& mount, double focal_px);

  /// Least squares over the corners of all seen plates, from where they are at the zero: Gauss-Newton with three steps,
  /// which moves of up to 0.2 rad need. Infinite distances behind the camera. Never allocates.
  RigidMotionFit fit(const PlateSight& sight, const ZeroPose& zero) const;

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
