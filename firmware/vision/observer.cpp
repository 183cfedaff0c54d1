#include "firmware/vision/observer.h"

namespace finsight {

Observation Observer::observe(const Frame& frame, const ZeroPose& zero) {
  Observation seen{.exposure_ns = frame.exposure_ns, .sequence = frame.sequence};
  seen.image_fault = check_.check({frame.grey, frame.width_px, frame.height_px, frame.stride_bytes});
  if (check_.repeats()) return seen;  // an old image is not a measurement
  seen.poses = poses_.estimate(markers_.find(frame));
  if (seen.poses.seen_count() == kPlates) seen.rigid_motion = poses_.rigid_motion(zero);
  return seen;
}

}  // namespace finsight
