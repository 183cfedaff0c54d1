// Where frames come from. One interface because there are two kinds of hardware behind it: a real camera (libcamera,
// on boards) and a replayed recording.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "firmware/ports/session.h"
#include "firmware/types.h"

namespace finsight {

class Camera {
 public:
  virtual ~Camera() = default;
  /// Waits for the next frame, at most `timeout_ms`. False: no frame came, see ended(). What `frame` points to stays
  /// valid until the next call. Never throws.
  virtual bool next(Frame& frame, int timeout_ms) = 0;
  /// No frame will come any more: a replay is over and does not repeat, or it failed (see error()).
  virtual bool ended() const = 0;
  /// Why frames stopped coming; empty while all is well.
  virtual std::string error() const = 0;
};

/// Nanoseconds of the steady clock; tests bring their own time.
struct ReplayClock {
  std::function<std::int64_t()> now_ns;
  std::function<void(std::int64_t)> sleep_until_ns;
};
ReplayClock steady_replay_clock();

struct ReplaySettings {
  std::filesystem::path path;  ///< session folder, or CSV file of plate motions
  std::string recording;       ///< which recording of a CSV file; empty: all of them
  bool recorded_speed = true;  ///< false: as fast as frames are asked for, and none is left out
  bool repeat = false;
  ReplayClock clock = steady_replay_clock();
};

/// Replays. The recording starts with the first call of next(); frame k is then exposed k / frames_per_second later. At
/// recorded speed a late caller gets the newest frame that is due, and the gap in `sequence` shows how many it missed;
/// at full speed every frame comes, exposed "now". `sequence` counts on over repetitions: sequence modulo the number of
/// recorded frames is the row of truth.csv or of the recording. All throw InputError for recordings that cannot be
/// used; a fault met later, in the middle of the file, ends the replay with error().
std::unique_ptr<Camera> open_session_camera(const ReplaySettings& settings);
/// Frames with plate poses instead of pictures: only the top plate is seen, at 60 frames per second.
std::unique_ptr<Camera> open_pose_camera(const ReplaySettings& settings);

}  // namespace finsight
