// Frame -> Observation: image check, markers, plate poses. The only folder of the firmware that uses OpenCV, and only
// in aruco_compat.cpp and marker_detector.cpp.
#pragma once

#include "firmware/vision/image_check.h"
#include "firmware/vision/marker_stage.h"
#include "firmware/vision/pose_stage.h"
#include "firmware/vision/rolling_shutter.h"

namespace finsight {

class Observer {
 public:
  /// Throws InputError for an impossible lens, mount or prior.
  /// `readout_ns`: see RollingShutter.
  Observer(const MountModel& mount, const PlatePrior& prior, const Lens& lens, std::int64_t readout_ns = 0)
      : shutter_(readout_ns),
        markers_(mount, in_single_precision(lens)),
        poses_(mount, prior, in_single_precision(lens)) {}

  /// What the frame shows. Poses are motions from the model's rest; invalid in an image that repeats an earlier one.
  /// `zero` is where the rigid motion of the whole finger, if all plates are seen, is counted from, and the prior's
  /// motions; `is_zeroing`: nothing touches the finger, whose rest is being measured. Allocates (OpenCV does), never
  /// throws.
  Observation observe(const Frame& frame, const ZeroPose& zero, bool is_zeroing = false);
  /// Those of the last image that did not repeat an earlier one, as they are in it.
  const MarkerCorners& corners() const { return markers_.last(); }

 private:
  bool find_missing(const Frame& frame, const std::array<bool, kPlates>& seen);

  ImageCheck check_;
  RollingShutter shutter_;
  MarkerStage markers_;
  PoseStage poses_;
};

}  // namespace finsight
