// Whether the camera still sits where it did: all plates seem to move like one rigid body, which no touch can do.
#pragma once

#include <array>
#include <optional>

#include "firmware/types.h"

namespace finsight {

class MountCheck {
 public:
  static constexpr int kFrames = 300;       ///< of standing still before anything is said: 5 s at 60 frames/s
  static constexpr float kStill_mm = 0.5F;  ///< further from the mean is a movement
  static constexpr int kBrief =
      30;  ///< frames; a shorter movement does not count, after a longer one the standing still starts over
  static constexpr double kKnocked_mm = 2;  ///< RigidMotionFit::size_mm: 1 mm per plate
  /// Angle by which corners may be off where one body says, per mm of its motion. Of all finite-element states of the
  /// default finger none leaves less than 1.2e-4; scatter leaves hardly any, because it is the same on both sides.
  static constexpr double kLargestRest_rad_mm = 7e-5;

  /// With every frame's zeroed poses, and how well one rigid motion explains what they were measured from. True while
  /// the finger stands still and is displaced as one body: the camera or the finger in its holder was knocked. Needs
  /// all three plates. Never allocates.
  bool update(const PlatePoses& poses, const std::optional<RigidMotionFit>& fit);
  /// Whether one rigid motion explains this frame alone: what it shows is no touch, knocked or not.
  static bool is_rigid_motion(const RigidMotionFit& fit) {
    const double rest_rad = kLargestRest_rad_mm * fit.size_mm;
    return fit.size_mm > kKnocked_mm && fit.unexplained_sq < rest_rad * rest_rad;
  }
  /// What was seen so far was seen from another zero.
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
