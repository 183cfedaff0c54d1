// Whether the camera still sits where it did: if it was knocked, all plates seem to have moved as one rigid body,
// which no touch can cause.
#pragma once

#include <array>
#include <optional>

#include "firmware/types.h"

namespace finsight {

class MountCheck {
 public:
  static constexpr int kFrames = 300;       ///< that the plates must stand still before the verdict: 5 s at 60 frames/s
  static constexpr float kStill_mm = 0.5F;  ///< a plate further than this from its mean has moved
  /// Frames: a shorter movement is ignored, after a longer one the plates must stand still from the start.
  static constexpr int kBrief = 30;
  static constexpr double kKnocked_mm = 2;  ///< RigidMotionFit::size_mm: 1 mm per plate
  /// Residual angle of the corners per mm of rigid motion up to which that motion explains them. All finite-element
  /// states of the default finger leave at least 1.2e-4; a knocked camera leaves hardly any.
  static constexpr double kMaxResidual_rad_mm = 7e-5;

  /// To be called with every frame's zeroed poses and how well one rigid motion explains the corners that they were
  /// measured from. True while the finger stands still and is displaced as one body: the camera, or the finger in its
  /// holder, was knocked. Frames without all three plates change nothing. Never allocates.
  bool update(const PlatePoses& poses, const std::optional<RigidMotionFit>& fit);
  /// Whether one rigid motion explains this frame alone: then it does not show a touch, knocked or not.
  static bool is_rigid_motion(const RigidMotionFit& fit) {
    const double residual_rad = kMaxResidual_rad_mm * fit.size_mm;
    return fit.size_mm > kKnocked_mm && fit.unexplained_sq < residual_rad * residual_rad;
  }
  /// Forgets what was measured from another zero.
  void reset() {
    frames_ = moving_ = 0;
    knocked_ = false;
  }

 private:
  std::array<Vec3f, kPlates> mean_mm_;  ///< displacements
  RigidMotionFit mean_fit_;
  int frames_ = 0, moving_ = 0;
  bool knocked_ = false;
};

}  // namespace finsight
