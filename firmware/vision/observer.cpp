#include "firmware/vision/observer.h"

namespace finsight {

Observation Observer::observe(const Frame& frame, const ZeroPose& zero, bool is_zeroing) {
  Observation seen{.exposure_ns = frame.exposure_ns, .sequence = frame.sequence};
  seen.image_fault = check_.check({frame.grey, frame.width_px, frame.height_px, frame.stride_bytes});
  if (check_.repeats()) return seen;  // an old image is not a measurement
  markers_.find(frame);
  poses_.set_rest(zero, is_zeroing);
  seen.poses = poses_.estimate(markers_.last(), markers_.edges());
  const bool found_more = seen.poses.quality == Quality::kFresh && find_missing(frame, seen.poses.seen);
  // What was found again, or that rows are of different times, makes other poses.
  MarkerCorners corners = markers_.last();
  shutter_.straighten(frame, corners);
  if (found_more || shutter_.is_rolling()) seen.poses = poses_.estimate(corners, markers_.edges());
  if (seen.poses.seen_count() == kPlates) seen.rigid_motion = poses_.rigid_motion(zero);
  return seen;
}

/// Where the others say that a missing marker should be.
bool Observer::find_missing(const Frame& frame, const std::array<bool, kPlates>& seen) {
  bool found = false;
  for (std::size_t p = 0; p < kPlates; ++p) {
    if (seen[p] || markers_.last().seen[p]) continue;
    const auto expected_px = poses_.expected_corners(p);
    if (expected_px) found |= markers_.find_at(frame, p, *expected_px);
  }
  return found;
}

}  // namespace finsight
