#include <chrono>
#include <cmath>
#include <thread>

#include "firmware/input_error.h"
#include "firmware/ports/camera.h"

namespace finsight {

namespace {

/// What both kinds of replay share: time, order and repetition.
template <class Sample>
class Replay : public Source<Sample> {
 public:
  bool next(Sample& sample, int timeout_ms) final {
    if (ended_) return false;
    std::int64_t now_ns = settings_.clock.now_ns();
    if (next_ == 0) start_ns_ = now_ns;
    std::uint64_t due = next_;
    if (settings_.recorded_speed) {
      const std::int64_t limit_ns = now_ns + kNsPerMs * timeout_ms;
      const std::int64_t wake_ns = std::min(exposure_ns(next_), limit_ns);
      if (wake_ns > now_ns) settings_.clock.sleep_until_ns(wake_ns);
      if (wake_ns < exposure_ns(next_)) return false;
      now_ns = std::max(wake_ns, settings_.clock.now_ns());
      due = std::max(next_, newest_frame_at(now_ns));
    }
    if (!advance_to(due, sample)) return false;
    sample.exposure_ns = settings_.recorded_speed ? exposure_ns(due) : now_ns;
    sample.sequence = static_cast<std::uint32_t>(due);
    next_ = due + 1;
    return true;
  }
  bool ended() const final { return ended_; }
  std::string error() const final { return error_; }

 protected:
  Replay(const ReplaySettings& settings, double frames_per_second)
      : settings_(settings), frames_per_second_(frames_per_second) {}
  /// Reads the next recorded sample, or skips it if `sample` is null. False after the last one. Throws InputError.
  virtual bool read(Sample* sample) = 0;
  virtual void rewind() = 0;

 private:
  std::int64_t exposure_ns(std::uint64_t frame) const {
    return start_ns_ + std::llround(static_cast<double>(frame) * 1e9 / frames_per_second_);
  }

  std::uint64_t newest_frame_at(std::int64_t now_ns) const {
    return static_cast<std::uint64_t>(static_cast<double>(now_ns - start_ns_) * frames_per_second_ / 1e9);
  }

  /// Skips the frames that a late caller missed and reads frame `due`.
  bool advance_to(std::uint64_t due, Sample& sample) {
    try {
      for (std::uint64_t at = next_; at <= due; ++at) {
        Sample* wanted = at == due ? &sample : nullptr;
        if (read(wanted)) continue;
        if (settings_.repeat) rewind();
        if (!settings_.repeat || !read(wanted)) {
          ended_ = true;
          return false;
        }
      }
      return true;
    } catch (const InputError& error) {
      // next() must not throw: a recording that breaks off is a camera that failed.
      error_ = error.what();
      ended_ = true;
      return false;
    }
  }

  ReplaySettings settings_;
  double frames_per_second_;
  std::int64_t start_ns_ = 0;
  std::uint64_t next_ = 0;  // frame to deliver next, counted over repetitions
  bool ended_ = false;
  std::string error_;
};

class SessionCamera : public Replay<Frame> {
 public:
  SessionCamera(const ReplaySettings& settings, const SessionInfo& info)
      : Replay(settings, info.frames_per_second),
        images_(settings.path / kSessionFrames, !info.complete),
        coding_(info.coding) {
    const auto check = [&](const char* field, double found, double expected) {
      if (std::abs(found - expected) < 1e-6 * expected) return;  // a rate is written as a ratio
      throw InputError((settings.path / kSessionFrames).string(), field, std::to_string(found),
                       std::to_string(expected) + " as in " + kSessionInfo);
    };
    check("width", images_.width_px(), info.lens.width_px);
    check("height", images_.height_px(), info.lens.height_px);
    check("frames per second", images_.frames_per_second(), info.frames_per_second);
    // Read the first frame now: a session without a complete frame is refused before the loop, and no frame allocates.
    if (!images_.next(grey_)) throw InputError((settings.path / kSessionFrames).string(), "holds no frame");
    images_.rewind();
  }

 private:
  bool read(Frame* frame) final {
    if (!frame) return images_.skip();
    if (!images_.next(grey_)) return false;
    *frame = Frame{.grey = grey_.data(),
                   .width_px = images_.width_px(),
                   .height_px = images_.height_px(),
                   .stride_bytes = images_.width_px(),
                   .coding = coding_};
    return true;
  }
  void rewind() final { images_.rewind(); }

  Y4mReader images_;
  Coding coding_;
  std::vector<std::uint8_t> grey_;
};

class PoseFileReplay : public Replay<Observation> {
 public:
  static constexpr double kFramesPerSecond = 60;  // of all published recordings

  explicit PoseFileReplay(const ReplaySettings& settings)
      : Replay(settings, kFramesPerSecond), motion_(read_recorded_motion(settings.path, settings.recording)) {}

 private:
  bool read(Observation* seen) final {
    if (at_ == motion_.poses.size()) return false;
    if (seen) *seen = Observation{.poses = motion_.poses[at_]};
    ++at_;
    return true;
  }
  void rewind() final { at_ = 0; }

  RecordedMotion motion_;
  std::size_t at_ = 0;
};

}  // namespace

ReplayClock steady_replay_clock() {
  using Clock = std::chrono::steady_clock;
  using std::chrono::nanoseconds;
  return {.now_ns = steady_now_ns, .sleep_until_ns = [](std::int64_t until_ns) {
            std::this_thread::sleep_until(
                Clock::time_point(std::chrono::duration_cast<Clock::duration>(nanoseconds(until_ns))));
          }};
}

std::unique_ptr<Camera> open_session_camera(const ReplaySettings& settings, const SessionInfo& info) {
  return std::make_unique<SessionCamera>(settings, info);
}

std::unique_ptr<PoseReplay> open_pose_replay(const ReplaySettings& settings) {
  return std::make_unique<PoseFileReplay>(settings);
}

}  // namespace finsight
