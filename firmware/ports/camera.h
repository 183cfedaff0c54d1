// Where frames come from. An interface, because there are several sources: a real camera (libcamera, on boards), a
// wrapper that opens it again when it is lost, and replayed recordings. Recorded plate motions have a source of their
// own, because they are observations already.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "firmware/ports/session.h"
#include "firmware/types.h"

namespace finsight {

/// A camera's counters beside its frames' sequence numbers, whose gaps are the dropped frames.
struct CameraCounts {
  std::uint32_t late = 0;      ///< frames that came more than two frame times after their exposure
  std::uint32_t losses = 0;    ///< how often it stopped and had to be opened again
  std::uint32_t openings = 0;  ///< attempts to open it: grows while it is missing
  std::uint32_t broken = 0;    ///< pictures that could not be decoded
  double rate_hz = 0;          ///< frames that the camera gives, taken or not; 0: not known
  bool is_slow = false;        ///< that is less than half of what was wanted
  bool breaks = false;         ///< some pictures of the last two seconds were broken
};

/// How a source is doing.
class SourceStatus {
 public:
  virtual ~SourceStatus() = default;
  /// Nothing more will come: a replay is over and does not repeat, or it failed (see error()).
  virtual bool ended() const = 0;
  /// Why samples stopped coming; empty while all is well.
  virtual std::string error() const = 0;
  virtual CameraCounts counts() const { return {}; }
};

/// What gives samples, one after the other: a Camera frames, a PoseReplay observations.
template <class Sample>
class Source : public SourceStatus {
 public:
  /// Waits for the next sample, at most `timeout_ms`. False: none came, see ended(). What `sample` points to stays
  /// valid until the next call. Never throws.
  virtual bool next(Sample& sample, int timeout_ms) = 0;
};
using Camera = Source<Frame>;
using PoseReplay = Source<Observation>;

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
/// at full speed every frame comes, exposed "now". `sequence` continues over repetitions: sequence modulo the number of
/// recorded frames is the row of truth.csv or of the recording. All throw InputError for recordings that cannot be
/// used; a fault further on in the file ends the replay with error(). `info`: of that session.
std::unique_ptr<Camera> open_session_camera(const ReplaySettings& settings, const SessionInfo& info);
/// Observations of a recording in which only the top plate is seen, at 60 per second.
std::unique_ptr<PoseReplay> open_pose_replay(const ReplaySettings& settings);

/// Which camera, and its mode.
struct LiveCameraSettings {
  std::string name = "";  ///< part of the camera's id or model; empty: the only one there is
  int width_px = 0, height_px = 0;
  double frames_per_second = 0;                   ///< applied if the camera supports it
  std::optional<int> exposure_us = std::nullopt;  ///< either of these two ends the camera's automatic exposure
  std::optional<double> gain = std::nullopt;
  std::optional<Coding> coding = std::nullopt;  ///< not told: see coding_or_linear()
  /// Of a rolling shutter, from the first row to the last; 0: a global one. Not told: taken for a global one.
  std::optional<double> readout_ms = std::nullopt;
  int stall_ms = 500;  ///< a camera without a frame for this time is lost

  Coding coding_or_linear() const { return coding.value_or(Coding::kLinear); }
};

/// A camera that outlives failures of the hardware: while it is missing, refuses its settings, is unplugged or stalls,
/// next() returns no frame, error() says why, and a thread tries to open it after 0.1 s, 0.2 s, ... 1 s. That thread
/// exists from the start, so threads that a camera starts inherit nothing from the one that calls next(). `sequence`
/// continues without a gap. `report` is called from that thread when the reason changes, with the format that was
/// chosen, and when the camera's frame rate is first known or becomes too slow or fast enough. Throws InputError in a
/// build without libcamera.
std::unique_ptr<Camera> open_live_camera(const LiveCameraSettings& settings,
                                         std::function<void(const std::string&)> report);

/// The same around any camera, for tests: `open` throws std::exception when there is no camera now.
std::unique_ptr<Camera> keep_open(std::function<std::unique_ptr<Camera>()> open, const LiveCameraSettings& settings,
                                  std::function<void(const std::string&)> report, const ReplayClock& clock);

/// The camera itself, opened once, through libcamera (not in a build without it); ended() says that it is lost. Throws
/// InputError listing what is available if no camera, mode, control or range matches. Tells `report` the format that
/// was chosen, and why. Broken pictures are counted and left out; the sequence shows the gap.
std::unique_ptr<Camera> open_libcamera(const LiveCameraSettings& settings,
                                       const std::function<void(const std::string&)>& report);

}  // namespace finsight
