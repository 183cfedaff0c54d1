#include "firmware/loop/pose_filter.h"

#include "firmware/geometry/plate_motion.h"

namespace finsight {

namespace {

constexpr double kLongestGap_ns = 200e6;

}  // namespace

void PoseFilter::apply(PlatePoses& poses, std::int64_t exposure_ns) {
  if (!(delay_ns_ > 0) || poses.quality != Quality::kFresh) return;
  const auto elapsed_ns = static_cast<double>(exposure_ns - last_ns_);
  const bool follows =
      last_.quality == Quality::kFresh && last_.seen == poses.seen && elapsed_ns > 0 && elapsed_ns < kLongestGap_ns;
  last_ns_ = exposure_ns;
  if (follows) {
    const auto part = static_cast<float>(elapsed_ns / (delay_ns_ + elapsed_ns));
    for (int p = 0; p < kPlates; ++p) poses.plates[p] = lerp(last_.plates[p], poses.plates[p], part);
  }
  last_ = poses;
}

}  // namespace finsight
