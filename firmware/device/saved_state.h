// What clients changed and saved: the settings and the zero, in one small TOML file.
#pragma once

#include <atomic>
#include <filesystem>
#include <optional>
#include <semaphore>
#include <string>
#include <thread>

#include "firmware/loop/zero.h"
#include "firmware/modbus/registers.h"
#include "firmware/settings/measured_mount.h"

namespace finsight {

struct SavedState {
  RuntimeSettings settings;
  std::optional<ZeroPose> zero;
  std::optional<Vec3f> zero_g =
      std::nullopt;  ///< acceleration of things that fell when the zero was measured, if known
};

/// What a zero was measured with. It is meaningless for another finger, and once camera or markers sit elsewhere.
struct ZeroBasis {
  std::uint32_t model_checksum = 0;
  MeasuredMount mount;
};

struct LoadedState {
  SavedState state;
  std::string problem;  ///< what was not used, and why; empty: nothing
};

/// Nothing if there is no such file. Throws InputError for a file that is not complete or not valid. A zero of another
/// basis is left out, and so is one of a version 1 file, which does not say its basis; the settings are used all the
/// same. Without `basis` (there is no model) any zero is left out, and that is no problem.
std::optional<LoadedState> load_state(const std::filesystem::path& file, const ZeroBasis* basis);

/// What to start with: what was saved, or the factory settings if `file` is empty, does not exist or cannot be used.
/// Never throws InputError: see `problem`.
LoadedState load_state_or_factory(const std::filesystem::path& file, const ZeroBasis* basis,
                                  const RuntimeSettings& factory);

/// A power cut at any moment leaves the old file or the new one. Throws std::system_error.
void save_state(const std::filesystem::path& file, const SavedState& state, const ZeroBasis& basis);

/// Saves in a thread of its own, so that the frame loop does not wait for a disk.
class StateSaver {
 public:
  /// `basis` of every zero that will be saved.
  StateSaver(std::filesystem::path file, ZeroBasis basis);
  ~StateSaver();  ///< after what was begun is saved
  StateSaver(const StateSaver&) = delete;
  StateSaver& operator=(const StateSaver&) = delete;

  /// Must not be called again before outcome() has returned the result.
  void begin(const SavedState& state);
  std::optional<bool> outcome();  ///< once after each begin(): whether the state is saved

 private:
  void run();
  enum class Progress : std::uint8_t { kIdle, kSaving, kSaved, kFailed };
  const std::filesystem::path file_;
  const ZeroBasis basis_;
  SavedState state_;
  std::atomic<Progress> progress_{Progress::kIdle};
  std::atomic<bool> stopping_{false};
  std::counting_semaphore<> work_{0};  ///< a save and the end may both be waiting
  std::thread thread_;
};

}  // namespace finsight
