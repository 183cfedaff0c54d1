#include "firmware/page/recordings.h"

#include <algorithm>
#include <chrono>
#include <fstream>
#include <system_error>
#include <utility>
#include <vector>

#include "firmware/page/tar.h"

namespace finsight::page {

namespace {

namespace fs = std::filesystem;

constexpr std::chrono::seconds kBegins(2);  // what is this young is being written, whatever the registers still say

bool says_complete(const fs::path& session) {
  std::ifstream in(session / "session.toml");
  for (std::string line; std::getline(in, line);) {
    if (line.starts_with("complete = false")) return false;
  }
  return true;
}

}  // namespace

bool Recordings::is_name(const std::string& name) {
  constexpr std::string_view kPrefix = "session-";
  return name.size() > kPrefix.size() && name.size() <= kPrefix.size() + 10 && name.starts_with(kPrefix) &&
         std::ranges::all_of(name.substr(kPrefix.size()), [](char c) { return c >= '0' && c <= '9'; });
}

nlohmann::json Recordings::list() const {
  std::vector<nlohmann::json> sessions;
  std::error_code error;
  if (folder_.empty()) return sessions;
  for (fs::directory_iterator at(folder_, error), end; !error && at != end; at.increment(error)) {
    const std::string name = at->path().filename();
    if (!is_name(name)) continue;
    std::uintmax_t bytes = 0;
    std::error_code unreadable;
    for (fs::directory_iterator file(at->path(), unreadable); !unreadable && file != end; file.increment(unreadable)) {
      std::error_code gone;
      const auto size = file->file_size(gone);
      if (!gone) bytes += size;
    }
    const auto changed = std::chrono::file_clock::to_sys(at->last_write_time(unreadable)).time_since_epoch();
    sessions.push_back(
        nlohmann::json{{"name", name},
                       {"bytes", bytes},
                       {"complete", says_complete(at->path())},
                       {"changed_s", std::chrono::duration_cast<std::chrono::seconds>(changed).count()}});
  }
  std::ranges::sort(sessions, std::greater<>{}, [](const nlohmann::json& s) { return s["name"].get<std::string>(); });
  return sessions;
}

std::function<std::int64_t(char*, std::size_t)> Recordings::tar(const std::string& name) const {
  if (folder_.empty() || !is_name(name)) return nullptr;
  std::vector<TarPart> parts;
  std::error_code error;
  for (fs::directory_iterator at(folder_ / name, error), end; !error && at != end; at.increment(error)) {
    std::error_code gone;
    if (!at->is_regular_file(gone)) continue;
    const std::uintmax_t bytes = at->file_size(gone);
    const std::string file = name + "/" + at->path().filename().string();
    if (!gone && file.size() < 100) parts.push_back({.name = file, .file = at->path(), .bytes = bytes});
  }
  if (error || parts.empty()) return nullptr;
  std::ranges::sort(parts, {}, &TarPart::name);
  return tar_of(std::move(parts));
}

std::optional<Refusal> Recordings::remove(const std::string& name, std::optional<bool> is_recording) const {
  std::error_code error;
  if (folder_.empty() || !is_name(name) || !fs::is_directory(folder_ / name, error)) {
    return Refusal{404, "There is no recording of that name."};
  }
  // A recording that was cut off is incomplete for ever. The one that is being written is the newest.
  if (!says_complete(folder_ / name)) {
    if (!is_recording) {
      return Refusal{503, "The measuring program does not answer, so it may still be writing this recording."};
    }
    const bool has_just_begun = fs::file_time_type::clock::now() - fs::last_write_time(folder_ / name, error) < kBegins;
    if (has_just_begun || (*is_recording && list()[0]["name"] == name)) {
      return Refusal{409, "This recording is still running."};
    }
  }
  fs::remove_all(folder_ / name, error);
  if (error) return Refusal{500, "It cannot be deleted: " + error.message() + "."};
  return std::nullopt;
}

}  // namespace finsight::page
