// Signed updates that come over the network: this program only puts the file down. The device's updater, which has the
// rights, judges it, writes the other slot and leaves the result.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "firmware/page/request_guard.h"

namespace finsight::page {

/// A body that is too long for memory: refused, or taken piece by piece. `take` returns false when it cannot go on.
struct Intake {
  std::optional<Refusal> refusal = std::nullopt;
  std::function<bool(std::string_view piece)> take = nullptr;
};

/// Thread-safe. FOLDER/spool is this program's, and upload.update in it a whole file that waits for the updater;
/// FOLDER/result.txt is the updater's.
class Updates {
 public:
  static constexpr std::uintmax_t kLongest = 512U << 20;

  /// `folder`: empty if this device has no updates. `release`: says which version runs (version=...). `restarts`: a
  /// file that exists between an update and the restart.
  Updates(std::filesystem::path folder, std::filesystem::path release, std::filesystem::path restarts);

  /// {"available", "version", "room_bytes", "state", "to", "text"}. state: "none", "receiving", "installing",
  /// "restarting", "running", "went_back", "refused".
  nlohmann::json state();
  /// For a file of so many bytes. It is there as a whole once the last of them was taken; otherwise not at all.
  Intake begin(std::uintmax_t bytes);

 private:
  struct Upload;
  const std::filesystem::path folder_, release_, restarts_;
  std::mutex mutex_;
  std::weak_ptr<Upload> upload_;
};

}  // namespace finsight::page
