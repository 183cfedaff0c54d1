#include "firmware/device/log.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdio>
#include <ctime>
#include <mutex>
#include <system_error>

#include "firmware/settings/settings.h"

namespace finsight {

namespace {

constexpr off_t kMost_bytes = 32 * 1024;  // then the file becomes the one before

std::mutex mutex;
std::filesystem::path kept;  ///< folder; empty: nowhere

/// A clock without a battery is wrong, and a log without times is worth less.
std::string now() {
  const std::time_t seconds = std::time(nullptr);
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  char text[32];
  return {text, std::strftime(text, sizeof text, "%Y-%m-%d %H:%M:%SZ ", &utc)};
}

}  // namespace

void log_message(const std::string& message) {
  std::fprintf(stderr, "finsightd: %s\n", message.c_str());
  const std::lock_guard guard(mutex);
  if (kept.empty()) return;
  const std::filesystem::path file = kept / kLogName;
  const int descriptor = open(file.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC, 0640);
  if (descriptor < 0) return;
  fchmod(descriptor, 0640);  // whatever the umask: the page's user is in the file's group
  const std::string line = now() + message + "\n";
  const bool is_written = write(descriptor, line.data(), line.size()) == static_cast<ssize_t>(line.size());
  struct stat found {};
  const bool is_full = is_written && fstat(descriptor, &found) == 0 && found.st_size > kMost_bytes;
  close(descriptor);
  std::error_code ignored;
  if (is_full) std::filesystem::rename(file, kept / kLogBefore, ignored);
}

void keep_log(const std::filesystem::path& folder) {
  std::error_code ignored;
  std::filesystem::create_directories(folder, ignored);
  const std::lock_guard guard(mutex);
  kept = folder;
}

}  // namespace finsight
