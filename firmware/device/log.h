// The service's log: one line per message, to standard error, and where the page shows it.
#pragma once

#include <filesystem>
#include <string>

namespace finsight {

/// Thread-safe.
void log_message(const std::string& message);

/// From now on messages are also kept in `folder`, the last 64 kB of them, for the page. Where that fails there are
/// none.
void keep_log(const std::filesystem::path& folder);

/// Of one finger; `finger` is its name, empty on a board that has only one.
inline void log_message(const std::string& finger, const std::string& message) {
  log_message(finger.empty() ? message : finger + ": " + message);
}

}  // namespace finsight
