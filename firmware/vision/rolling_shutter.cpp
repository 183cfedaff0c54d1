#include "firmware/vision/rolling_shutter.h"

#include <utility>

namespace finsight {

namespace {

constexpr std::int64_t kOldest_ns = 100 * kNsPerMs;

}  // namespace

/// From the frame's time to the exposure of this row.
float RollingShutter::after_middle_ns(const Frame& frame, float row) const {
  return static_cast<float>(readout_ns_) * (row / static_cast<float>(frame.height_px) - 0.5F);
}

void RollingShutter::straighten(const Frame& frame, MarkerCorners& corners) {
  if (!is_rolling()) return;
  for (std::size_t p = 0; p < kPlates; ++p) {
    if (!corners.seen[p]) continue;
    std::array<Vec2f, 4>& corner = corners.corners_px[p];
    Sighting now;
    now.middle_px = (corner[0] + corner[1] + corner[2] + corner[3]) / 4;
    now.seen_ns = frame.exposure_ns + static_cast<std::int64_t>(after_middle_ns(frame, now.middle_px.y()));
    const Sighting before = std::exchange(last_[p], now);
    const std::int64_t since_ns = now.seen_ns - before.seen_ns;
    // No camera starts a picture before it has read the last: frames nearer than that have times that are not theirs.
    if (before.seen_ns == 0 || since_ns < readout_ns_ / 2 || since_ns > kOldest_ns) continue;
    const Vec2f per_ns = (now.middle_px - before.middle_px) / static_cast<float>(since_ns);
    for (Vec2f& at : corner) at -= per_ns * after_middle_ns(frame, at.y());
  }
}

}  // namespace finsight
