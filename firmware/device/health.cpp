#include "firmware/device/health.h"

#include <algorithm>
#include <limits>

namespace finsight {

/// Whether the block published last is stalled.
bool Health::note_stall(std::int64_t now_ns) {
  const std::int64_t since_ns = control_.stalled_since_ns(last_, now_ns);
  if (since_ns != 0) health_.note_fault(static_cast<std::uint16_t>(FaultCode::kStalled), since_ns);
  return since_ns != 0;
}

void Health::begin_turn(std::int64_t now_ns) {
  if (note_stall(now_ns)) control_.show_health(health_);
}

void Health::note(const RegisterImage& image, bool has_frame, std::int64_t began_ns, std::int64_t ended_ns,
                  const Counts& counts) {
  note_stall(ended_ns);  // the turn itself may have taken too long
  last_ = image;
  if (!note_stall(ended_ns)) health_.note_fault(image.words[address_of("fault")], ended_ns);
  health_.frames = counts.frames;
  health_.dropped = counts.dropped;
  health_.camera_losses = counts.camera_losses;
  health_.pictures_broken = counts.pictures_broken;
  const auto camera_rate_hz = static_cast<float>(counts.camera_rate_hz);
  health_.camera_rate_hz = camera_rate_hz > 0 ? camera_rate_hz : std::numeric_limits<float>::quiet_NaN();
  if (has_frame) health_.longest_ns = std::max(health_.longest_ns, ended_ns - began_ns);

  if (window_began_ns_ == 0) {
    window_began_ns_ = ended_ns;
  } else {
    window_busy_ns_ += ended_ns - began_ns;
    window_frames_ += has_frame;
  }
  const std::int64_t window_ns = ended_ns - window_began_ns_;
  if (window_ns >= kWindow_ns) {
    constexpr float kNsPerSecond = 1e9F;
    health_.frame_rate_hz = static_cast<float>(window_frames_) * kNsPerSecond / static_cast<float>(window_ns);
    health_.load = static_cast<float>(window_busy_ns_) / static_cast<float>(window_ns);
    window_began_ns_ = ended_ns;
    window_busy_ns_ = 0;
    window_frames_ = 0;
  }
  control_.show_health(health_);
}

}  // namespace finsight
