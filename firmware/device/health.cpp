#include "firmware/device/health.h"

#include <algorithm>

namespace finsight {

void Health::note(const RegisterImage& image, bool has_frame, std::int64_t began_ns, std::int64_t ended_ns,
                  const Counts& counts) {
  const std::int64_t stale_after_ns = control_.stale_after_ns();
  if (last_ended_ns_ != 0 && ended_ns - last_ended_ns_ > stale_after_ns) {
    constexpr auto kStalled = static_cast<std::uint16_t>(FaultCode::kStalled);
    health_.note_past_fault(kStalled, last_ended_ns_ + stale_after_ns, ended_ns);
  }
  last_ended_ns_ = ended_ns;
  health_.note_fault(image.words[address_of("fault")], ended_ns);
  health_.frames = counts.frames;
  health_.dropped = counts.dropped;
  health_.camera_losses = counts.camera_losses;
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
