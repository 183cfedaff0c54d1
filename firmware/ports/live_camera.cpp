#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <semaphore>
#include <thread>
#include <utility>

#include "firmware/input_error.h"
#include "firmware/ports/camera.h"
#include "firmware/ports/camera_modes.h"

namespace finsight {

namespace {

// With the time that a camera takes to be found, frames come within five seconds of plugging it in.
constexpr std::int64_t kFirstWaitNs = 100 * kNsPerMs, kLongestWaitNs = 1000 * kNsPerMs;
// A USB camera that has just been started may take seconds over its first frame.
constexpr std::int64_t kFirstFrameNs = 5000 * kNsPerMs;

class LiveCamera : public Camera {
 public:
  LiveCamera(std::function<std::unique_ptr<Camera>()> open, const LiveCameraSettings& settings,
             std::function<void(const std::string&)> report, const ReplayClock& clock)
      : open_(std::move(open)),
        report_(std::move(report)),
        clock_(clock),
        frame_time_ns_(static_cast<std::int64_t>(1e9 / settings.frames_per_second)),
        stall_ns_(settings.stall_ms * kNsPerMs),
        wanted_hz_(settings.frames_per_second),
        meter_(settings.frames_per_second),
        opener_([this] { run_opener(); }) {}

  ~LiveCamera() override {
    stopping_ = true;
    wanted_.release();
    opener_.join();
  }

  bool next(Frame& frame, int timeout_ms) override {
    const std::int64_t limit_ns = clock_.now_ns() + timeout_ms * kNsPerMs;
    if (!camera_ && !reopen(limit_ns)) return false;
    const std::int64_t left_ns = std::max<std::int64_t>(limit_ns - clock_.now_ns(), 0);
    if (camera_->next(frame, static_cast<int>(left_ns / kNsPerMs))) {
      accept(frame);
      return true;
    }
    const std::int64_t silent_ns = clock_.now_ns() - last_frame_ns_;
    if (camera_->ended()) {
      lose(camera_->error());
    } else if (silent_ns > (delivered_ ? stall_ns_ : std::max(stall_ns_, kFirstFrameNs))) {
      lose("no frame for " + std::to_string(silent_ns / kNsPerMs) + " ms");
    }
    return false;
  }

  bool ended() const override { return false; }
  std::string error() const override { return error_; }
  CameraCounts counts() const override {
    CameraCounts counts = counts_;
    if (camera_) counts.broken += camera_->counts().broken;
    counts.rate_hz = meter_.rate_hz();
    counts.is_slow = meter_.is_slow();
    return counts;
  }

 private:
  /// The camera's own counter restarts with every opening; ours continues.
  void accept(Frame& frame) {
    if (!delivered_) sequence_offset_ = next_sequence_ - frame.sequence;
    frame.sequence += sequence_offset_;
    next_sequence_ = frame.sequence + 1;
    last_frame_ns_ = clock_.now_ns();
    if (last_frame_ns_ - frame.exposure_ns > 2 * frame_time_ns_) ++counts_.late;
    delivered_ = true;
    wait_ns_ = kFirstWaitNs;
    error_.clear();
    if (meter_.note(frame.sequence, frame.exposure_ns)) judge_rate();
  }

  /// Every two seconds.
  void judge_rate() {
    const std::uint32_t broken = counts().broken;
    counts_.breaks = broken != std::exchange(broken_before_, broken);
    if (rate_is_told_ && meter_.is_slow() == was_slow_) return;
    rate_is_told_ = true;
    was_slow_ = meter_.is_slow();
    rate_to_tell_hz_ = static_cast<float>(meter_.rate_hz());
    wanted_.release();
  }

  void lose(const std::string& why) {
    ++counts_.losses;
    counts_.broken += camera_->counts().broken;
    counts_.breaks = false;
    meter_.restart();
    rate_is_told_ = false;
    lost_ = std::move(camera_);
    wait_before_retry(why);
  }

  void wait_before_retry(const std::string& why) {
    error_ = why;
    retry_ns_ = clock_.now_ns() + wait_ns_;
    wait_ns_ = std::min(2 * wait_ns_, kLongestWaitNs);
  }

  /// True once there is a camera. Closing the lost one and opening can take seconds when the hardware does not answer,
  /// so the opener does both.
  bool reopen(std::int64_t limit_ns) {
    if (!is_opening_) {
      clock_.sleep_until_ns(std::min(retry_ns_, limit_ns));
      if (clock_.now_ns() < retry_ns_) return false;
      is_opening_ = true;
      opening_is_wanted_ = true;
      wanted_.release();
    }
    const std::int64_t left_ns = std::max<std::int64_t>(limit_ns - clock_.now_ns(), 0);
    if (!done_.try_acquire_for(std::chrono::nanoseconds(left_ns))) return false;
    is_opening_ = false;
    ++counts_.openings;
    if (!opened_) {
      wait_before_retry(opening_error_);
      return false;
    }
    camera_ = std::move(opened_);
    last_frame_ns_ = clock_.now_ns();
    delivered_ = false;
    return true;
  }

  /// The opener's thread. It exists from the start and lets other threads inherit nothing of the frame loop's
  /// scheduling: those of the camera, which start with every opening.
  void run_opener() {
    for (;;) {
      wanted_.acquire();
      if (stopping_) return;
      if (const float rate_hz = rate_to_tell_hz_.exchange(0); rate_hz > 0) tell_rate(rate_hz);
      if (!opening_is_wanted_.exchange(false)) continue;
      if (!error_.empty()) report_change(error_);
      lost_.reset();
      try {
        opened_ = open_();
        opening_error_.clear();
      } catch (const std::exception& error) {
        opening_error_ = error.what();
      }
      report_change(opening_error_);
      done_.release();
    }
  }

  void tell_rate(float rate_hz) {
    char text[120];
    std::snprintf(text, sizeof text, "camera: gives %.1f frames/s of the wanted %.1f%s", static_cast<double>(rate_hz),
                  wanted_hz_, static_cast<double>(rate_hz) < wanted_hz_ / 2 ? ", less than half" : "");
    report_(text);
  }

  void report_change(const std::string& why) {
    if (why != reported_) report_(why.empty() ? "camera is open" : "camera: " + why);
    reported_ = why;
  }

  std::function<std::unique_ptr<Camera>()> open_;
  std::function<void(const std::string&)> report_;
  ReplayClock clock_;
  std::int64_t frame_time_ns_, stall_ns_;
  double wanted_hz_;
  FrameRateMeter meter_;
  bool was_slow_ = false, rate_is_told_ = false;
  std::uint32_t broken_before_ = 0;

  std::unique_ptr<Camera> camera_;
  bool delivered_ = false;  // a frame, since camera_ was opened
  std::int64_t last_frame_ns_ = 0, retry_ns_ = 0, wait_ns_ = kFirstWaitNs;
  std::uint32_t sequence_offset_ = 0, next_sequence_ = 0;
  CameraCounts counts_;
  bool is_opening_ = false;

  // Used by the opener between wanted_ and done_, by the caller of next() otherwise.
  std::unique_ptr<Camera> lost_, opened_;
  std::string error_, opening_error_;
  std::string reported_ = "not opened yet";

  std::atomic<bool> stopping_{false}, opening_is_wanted_{false};
  std::atomic<float> rate_to_tell_hz_{0};  // 0: nothing to tell
  std::counting_semaphore<> wanted_{0}, done_{0};
  std::thread opener_;  // last: it uses the others
};

}  // namespace

std::unique_ptr<Camera> keep_open(std::function<std::unique_ptr<Camera>()> open, const LiveCameraSettings& settings,
                                  std::function<void(const std::string&)> report, const ReplayClock& clock) {
  return std::make_unique<LiveCamera>(std::move(open), settings, std::move(report), clock);
}

#if FINSIGHT_HAS_LIBCAMERA
std::unique_ptr<Camera> open_live_camera(const LiveCameraSettings& settings,
                                         std::function<void(const std::string&)> report) {
  const auto open = [settings, report] { return open_libcamera(settings, report); };
  return keep_open(open, settings, report, steady_replay_clock());
}
#else
// Refused at once: waiting would not help.
std::unique_ptr<Camera> open_live_camera(const LiveCameraSettings&, std::function<void(const std::string&)>) {
  throw InputError("source.kind", "\"camera\" needs libcamera 0.4, which this build lacks (Debian 13 has it)");
}
#endif

}  // namespace finsight
