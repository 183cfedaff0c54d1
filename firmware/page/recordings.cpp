#include "firmware/page/recordings.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <memory>
#include <system_error>
#include <utility>
#include <vector>

namespace finsight::page {

namespace {

namespace fs = std::filesystem;
constexpr std::size_t kTarBlock = 512;

/// The head of a file in a tar archive (POSIX.1-1988, ustar).
std::array<char, kTarBlock> tar_head(const std::string& name, std::uintmax_t bytes) {
  std::array<char, kTarBlock> head{};
  std::snprintf(head.data(), 100, "%s", name.c_str());
  std::snprintf(head.data() + 100, 8, "%07o", 0644U);
  std::snprintf(head.data() + 108, 8, "%07o", 0U);
  std::snprintf(head.data() + 116, 8, "%07o", 0U);
  constexpr std::uintmax_t kMostInOctal = (std::uintmax_t{1} << 33) - 1;
  if (bytes <= kMostInOctal) {
    std::snprintf(head.data() + 124, 12, "%011llo", static_cast<unsigned long long>(bytes));
  } else {  // as GNU tar writes it: the top bit, then a big-endian number
    head[124] = static_cast<char>(0x80);
    for (std::size_t i = 0; i < 8; ++i) head[135 - i] = static_cast<char>(bytes >> (8 * i) & 0xFF);
  }
  std::snprintf(head.data() + 136, 12, "%011o", 0U);
  std::memset(head.data() + 148, ' ', 8);
  head[156] = '0';
  std::memcpy(head.data() + 257, "ustar\00000", 8);
  unsigned sum = 0;
  for (const char c : head) sum += static_cast<unsigned char>(c);
  std::snprintf(head.data() + 148, 8, "%06o", sum);
  return head;
}

/// A file of the archive, with the length that it had when the download began: a recording may still grow.
struct Part {
  fs::path file;
  std::string name;
  std::uintmax_t bytes;
};

class Tar {
 public:
  explicit Tar(std::vector<Part> parts) : parts_(std::move(parts)) {}

  std::int64_t more(char* bytes, std::size_t room) {
    std::size_t given = 0;
    while (given < room && fill()) {
      const std::size_t count = std::min(room - given, buffer_.size() - at_);
      std::memcpy(bytes + given, buffer_.data() + at_, count);
      at_ += count;
      given += count;
    }
    return static_cast<std::int64_t>(given);
  }

 private:
  /// Whether there is something in the buffer.
  bool fill() {
    if (at_ < buffer_.size()) return true;
    at_ = 0;
    buffer_.clear();
    if (left_ > 0) {
      const auto count = static_cast<std::size_t>(std::min<std::uintmax_t>(left_, 64 * 1024));
      buffer_.resize(count);
      in_.read(buffer_.data(), static_cast<std::streamsize>(count));  // what is missing stays zero
      left_ -= count;
      if (left_ == 0) buffer_.resize((count + kTarBlock - 1) / kTarBlock * kTarBlock);
      return true;
    }
    if (next_ < parts_.size()) {
      const Part& part = parts_[next_++];
      const auto head = tar_head(part.name, part.bytes);
      buffer_.assign(head.begin(), head.end());
      in_ = std::ifstream(part.file, std::ios::binary);
      left_ = part.bytes;
      return true;
    }
    if (std::exchange(is_ended_, true)) return false;
    buffer_.assign(2 * kTarBlock, '\0');
    return true;
  }

  const std::vector<Part> parts_;
  std::size_t next_ = 0, at_ = 0;
  std::vector<char> buffer_;
  std::ifstream in_;
  std::uintmax_t left_ = 0;
  bool is_ended_ = false;
};

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
  std::vector<Part> parts;
  std::error_code error;
  for (fs::directory_iterator at(folder_ / name, error), end; !error && at != end; at.increment(error)) {
    std::error_code gone;
    if (!at->is_regular_file(gone)) continue;
    const std::uintmax_t bytes = at->file_size(gone);
    const std::string file = name + "/" + at->path().filename().string();
    if (!gone && file.size() < 100) parts.push_back({at->path(), file, bytes});
  }
  if (error || parts.empty()) return nullptr;
  std::ranges::sort(parts, {}, &Part::name);
  const auto tar = std::make_shared<Tar>(std::move(parts));
  return [tar](char* bytes, std::size_t room) { return tar->more(bytes, room); };
}

std::optional<Refusal> Recordings::remove(const std::string& name) const {
  std::error_code error;
  if (folder_.empty() || !is_name(name) || !fs::is_directory(folder_ / name, error)) {
    return Refusal{404, "There is no recording of that name."};
  }
  if (!says_complete(folder_ / name)) {
    // It may be the one that is being written; a recording that was cut off says so for ever, so its age decides.
    const auto age = fs::file_time_type::clock::now() - fs::last_write_time(folder_ / name / "frames.y4m", error);
    if (!error && age < std::chrono::seconds(10)) return Refusal{409, "This recording is still running."};
  }
  fs::remove_all(folder_ / name, error);
  if (error) return Refusal{500, "It cannot be deleted: " + error.message() + "."};
  return std::nullopt;
}

}  // namespace finsight::page
