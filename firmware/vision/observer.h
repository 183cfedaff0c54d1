// Frame -> Observation: image check, markers, plate poses. The only folder of the firmware that uses OpenCV, and only
// in aruco_compat.cpp and marker_detector.cpp.
#pragma once

#include "firmware/vision/image_check.h"
#include "firmware/vision/marker_stage.h"
#include "firmware/vision/pose_stage.h"

namespace finsight {

class Observer {
 public:
  /// Throws InputError for an impossible lens, mount or prior.
  Observer(const MountModel& mount, const PlatePrior& prior, const Lens& lens)
      : markers_(mount, in_single_precision(lens)), poses_(mount, prior, in_single_precision(lens)) {}

  /// What the frame shows. Poses are motions from the model's rest; invalid in an image that repeats an earlier one.
  /// `zero` is where the rigid motion of the whole finger, if all plates are seen, is counted from. Allocates (OpenCV
  /// does), never throws.
  Observation observe(const Frame& frame, const ZeroPose& zero);
  /// Those of the last image that did not repeat an earlier one.
  const MarkerCorners& corners() const { return markers_.last(); }

 private:
  ImageCheck check_;
  MarkerStage markers_;
  PoseStage poses_;
};

}  // namespace finsight
