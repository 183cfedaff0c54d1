// What clients changed and saved: settings and the zero, in one small TOML file.
#pragma once

#include <atomic>
#include <filesystem>
#include <optional>
#include <semaphore>
#include <string>
#include <thread>

#include "firmware/loop/zero.h"
#include "firmware/modbus/registers.h"

namespace finsight {

struct SavedState {
  RuntimeSettings settings;
  std::optional<ZeroPose> zero;
};

/// Nothing if there is no such file. Throws InputError for a file that is not whole or not valid.
std::optional<SavedState> load_state(const std::filesystem::path& file);

/// Writes beside the file, syncs, and renames: a power cut at any moment leaves the old file or the new one. Creates
/// the folder if it is missing. Throws std::system_error.
void save_state(const std::filesystem::path& file, const SavedState& state);

/// Saves in a thread of its own, so that the frame loop does not wait for a disk.
class StateSaver {
 public:
  explicit StateSaver(std::filesystem::path file);
  ~StateSaver();
  StateSaver(const StateSaver&) = delete;
  StateSaver& operator=(const StateSaver&) = delete;

  /// Not again before outcome() has told how it went.
  void begin(const SavedState& state);
  std::optional<bool> outcome();  ///< of what was begun, once: whether it is saved

 private:
  void run();
  enum class Progress : std::uint8_t { kIdle, kSaving, kSaved, kFailed };
  const std::filesystem::path file_;
  SavedState state_;
  std::atomic<Progress> progress_{Progress::kIdle};
  std::atomic<bool> stopping_{false};
  std::binary_semaphore work_{0};
  std::thread thread_;
};

}  // namespace finsight
