// What clients changed and saved: the settings and the zero, in one small TOML file.
#pragma once

#include <atomic>
#include <filesystem>
#include <optional>
#include <semaphore>
#include <string>
#include <thread>

#include "firmware/settings/state_text.h"

namespace finsight {

/// Nothing if there is no such file. Throws InputError like read_state().
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
