// Whether the camera still sits where it did: all plates seem to move like one rigid body, which no touch can do.
#pragma once

#include "firmware/model/model.h"
#include "firmware/types.h"

namespace finsight {

class MountCheck {
 public:
  static constexpr int kFrames = 300;       ///< of standing still before anything is said: 5 s at 60 frames/s
  static constexpr float kStill_mm = 0.5F;  ///< further from the mean is a movement
  static constexpr int kBrief = 30;         ///< frames; a shorter movement does not count, a longer one begins anew
  static constexpr double kKnocked_mm = 2;  ///< length of the 18 numbers (mm, and 28.65 mm per rad): 1 mm per plate
  /// What a rigid motion leaves of that length. Of all finite-element states of the default finger none is below 0.107.
  static constexpr double kLargestRest = 0.07;

  explicit MountCheck(const MountModel& mount);

  /// With every frame's zeroed poses. True while the finger stands still and its plates are displaced as one body: the
  /// camera or the finger in its holder was knocked. Needs all three plates. Never allocates.
  bool look(const PlatePoses& poses);
  /// What was seen so far was seen from another zero.
  void begin_anew() {
    frames_ = moving_ = 0;
    knocked_ = false;
  }

 private:
  Eigen::Matrix<double, 18, 18> bent_;  ///< takes the rigid motion out of the scaled numbers
  Eigen::Matrix<double, 18, 1> mean_;
  int frames_ = 0, moving_ = 0;
  bool knocked_ = false;
};

}  // namespace finsight
