#include <algorithm>
#include <chrono>
#include <future>

#include "firmware/input_error.h"
#include "firmware/ports/camera.h"

namespace finsight {

namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kFirstWaitNs = 100 * kMs, kLongestWaitNs = 5000 * kMs;
// A USB camera that has just been started may take seconds over its first frame.
constexpr std::int64_t kFirstFrameNs = 5000 * kMs;

class LiveCamera : public Camera {
 public:
  LiveCamera(std::function<std::unique_ptr<Camera>()> open, const LiveCameraSettings& settings,
             std::function<void(const std::string&)> report, const ReplayClock& clock)
      : open_(std::move(open)),
        report_(std::move(report)),
        clock_(clock),
        frame_time_ns_(static_cast<std::int64_t>(1e9 / settings.frames_per_second)),
        stall_ns_(settings.stall_ms * kMs) {}

  bool next(Frame& frame, int timeout_ms) override {
    const std::int64_t limit_ns = clock_.now_ns() + timeout_ms * kMs;
    if (!camera_ && !reopen(limit_ns)) return false;
    const std::int64_t left_ns = std::max<std::int64_t>(limit_ns - clock_.now_ns(), 0);
    if (camera_->next(frame, static_cast<int>(left_ns / kMs))) {
      accept(frame);
      return true;
    }
    const std::int64_t silent_ns = clock_.now_ns() - last_frame_ns_;
    if (camera_->ended()) {
      lose(camera_->error());
    } else if (silent_ns > (delivered_ ? stall_ns_ : std::max(stall_ns_, kFirstFrameNs))) {
      lose("no frame for " + std::to_string(silent_ns / kMs) + " ms");
    }
    return false;
  }

  bool ended() const override { return false; }
  std::string error() const override { return error_; }
  CameraCounts counts() const override { return counts_; }

 private:
  struct Attempt {
    std::unique_ptr<Camera> camera;
    std::string error;  // why there is none
  };

  /// The camera's own counter starts anew with every opening; ours goes on.
  void accept(Frame& frame) {
    if (!delivered_) sequence_offset_ = next_sequence_ - frame.sequence;
    frame.sequence += sequence_offset_;
    next_sequence_ = frame.sequence + 1;
    last_frame_ns_ = clock_.now_ns();
    if (last_frame_ns_ - frame.exposure_ns > 2 * frame_time_ns_) ++counts_.late;
    delivered_ = true;
    wait_ns_ = kFirstWaitNs;
    error_.clear();
  }

  void lose(const std::string& why) {
    ++counts_.losses;
    lost_ = std::move(camera_);
    wait_before_retry(why);
  }

  void wait_before_retry(const std::string& why) {
    error_ = why;
    retry_ns_ = clock_.now_ns() + wait_ns_;
    wait_ns_ = std::min(2 * wait_ns_, kLongestWaitNs);
  }

  /// True once there is a camera. Closing the lost one and opening can take seconds when the hardware does not answer,
  /// so a thread does both; it only exists while there are no frames to be late for.
  bool reopen(std::int64_t limit_ns) {
    if (!opening_.valid()) {
      clock_.sleep_until_ns(std::min(retry_ns_, limit_ns));
      if (clock_.now_ns() < retry_ns_) return false;
      if (!start_opening()) return false;
    }
    const std::int64_t left_ns = std::max<std::int64_t>(limit_ns - clock_.now_ns(), 0);
    if (opening_.wait_for(std::chrono::nanoseconds(left_ns)) != std::future_status::ready) return false;
    Attempt attempt = opening_.get();
    ++counts_.openings;
    camera_ = std::move(attempt.camera);
    if (!camera_) {
      wait_before_retry(attempt.error);
      return false;
    }
    last_frame_ns_ = clock_.now_ns();
    delivered_ = false;
    return true;
  }

  bool start_opening() {
    try {
      opening_ = std::async(std::launch::async, [this, lost = std::move(lost_), why = error_]() mutable {
        if (!why.empty()) report_change(why);
        lost.reset();
        return attempt();
      });
      return true;
    } catch (const std::exception& error) {  // no thread to be had
      wait_before_retry(error.what());
      return false;
    }
  }

  Attempt attempt() {
    try {
      Attempt opened{open_(), ""};
      report_change("");
      return opened;
    } catch (const std::exception& error) {
      report_change(error.what());
      return {nullptr, error.what()};
    }
  }

  void report_change(const std::string& why) {
    if (why != reported_) report_(why.empty() ? "camera is open" : "camera: " + why);
    reported_ = why;
  }

  std::function<std::unique_ptr<Camera>()> open_;
  std::function<void(const std::string&)> report_;
  ReplayClock clock_;
  std::int64_t frame_time_ns_, stall_ns_;

  std::unique_ptr<Camera> camera_, lost_;
  bool delivered_ = false;  // a frame, since camera_ was opened
  std::int64_t last_frame_ns_ = 0, retry_ns_ = 0, wait_ns_ = kFirstWaitNs;
  std::uint32_t sequence_offset_ = 0, next_sequence_ = 0;
  std::string error_;
  CameraCounts counts_;
  std::string reported_ = "not opened yet";  // only the opening thread's
  std::future<Attempt> opening_;             // last: its destructor waits for the thread, which uses the others
};

}  // namespace

std::unique_ptr<Camera> keep_open(std::function<std::unique_ptr<Camera>()> open, const LiveCameraSettings& settings,
                                  std::function<void(const std::string&)> report, const ReplayClock& clock) {
  return std::make_unique<LiveCamera>(std::move(open), settings, std::move(report), clock);
}

#if FINSIGHT_HAS_LIBCAMERA
std::unique_ptr<Camera> open_live_camera(const LiveCameraSettings& settings,
                                         std::function<void(const std::string&)> report) {
  return keep_open([settings] { return open_libcamera(settings); }, settings, std::move(report), steady_replay_clock());
}
#else
// At once, since no time could mend it.
std::unique_ptr<Camera> open_live_camera(const LiveCameraSettings&, std::function<void(const std::string&)>) {
  throw InputError("source.kind", "\"camera\" needs libcamera 0.4, which this build lacks (Debian 13 has it)");
}
#endif

}  // namespace finsight
