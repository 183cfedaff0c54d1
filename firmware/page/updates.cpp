#include "firmware/page/updates.h"

#include <fstream>
#include <iterator>
#include <system_error>

#include "firmware/settings/atomic_file.h"

namespace finsight::page {

namespace {

using nlohmann::json;
namespace fs = std::filesystem;

constexpr std::uintmax_t kSpare_bytes = 4U << 20;  // stays free for log and settings
constexpr const char* kWhole = "upload.update";    // the updater looks for this name
constexpr std::size_t kMostText = 4000;

std::string text_of(const fs::path& file) {
  std::ifstream in(file);
  std::string text(std::istreambuf_iterator<char>(in), {});
  return text.size() > kMostText ? text.substr(text.size() - kMostText) : text;
}

/// The word that follows `before` in the text; empty if it is not there.
std::string word_after(const std::string& text, const std::string& before) {
  const std::size_t at = text.find(before);
  if (at == std::string::npos) return "";
  const std::size_t from = at + before.size();
  return text.substr(from, text.find_first_of(" \n", from) - from);
}

}  // namespace

struct Updates::Upload {
  Upload(const fs::path& spool, std::uintmax_t length) : file(spool / kWhole), left(length) {}
  AtomicFile file;  ///< goes away if it is not committed
  std::uintmax_t left;

  bool take(std::string_view piece) {
    if (piece.size() > left) return false;
    try {
      file.write(piece);
      left -= piece.size();
      if (left == 0) file.commit();
    } catch (const std::system_error&) {  // the disk is full
      return false;
    }
    return true;
  }
};

Updates::Updates(fs::path folder, fs::path release, fs::path restarts)
    : folder_(std::move(folder)), release_(std::move(release)), restarts_(std::move(restarts)) {
  // What an upload left behind that was cut off with this program.
  std::error_code error;
  for (fs::directory_iterator at(folder_ / "spool", error), end; !error && at != end; at.increment(error)) {
    std::error_code ignored;
    if (at->path().filename() != kWhole) fs::remove(at->path(), ignored);
  }
}

json Updates::state() {
  json state = {{"available", !folder_.empty()}, {"state", "none"}};
  if (folder_.empty()) return state;
  const std::string version = word_after(text_of(release_), "\nversion=");
  state["version"] = version;
  std::error_code error;
  const fs::space_info space = fs::space(folder_ / "spool", error);
  state["room_bytes"] = error || space.available < kSpare_bytes ? 0 : space.available - kSpare_bytes;
  const std::string text = text_of(folder_ / "result.txt"), to = word_after(text, "writing version ");
  state["text"] = text;
  const std::lock_guard guard(mutex_);
  if (!upload_.expired()) {
    state["state"] = "receiving";
  } else if (fs::exists(folder_ / "spool" / kWhole, error)) {
    state["state"] = "installing";
  } else if (!text.empty() && text.find("starts next") == std::string::npos) {
    state["state"] = "refused";
  } else if (!text.empty()) {
    state["to"] = to;
    state["state"] = fs::exists(restarts_, error) ? "restarting" : to == version ? "running" : "went_back";
  }
  return state;
}

Intake Updates::begin(std::uintmax_t bytes) {
  if (folder_.empty()) return {Refusal{409, "This device takes no updates: the board file has no page.updates."}};
  const json now = state();
  if (now["state"] == "installing" || now["state"] == "restarting" || now["state"] == "receiving") {
    return {Refusal{409, "Another update is being received or installed."}};
  }
  if (bytes == 0 || bytes > kLongest) return {Refusal{413, "An update has at most 512 MB."}};
  const auto room = now["room_bytes"].get<std::uintmax_t>();
  if (bytes > room) {
    return {Refusal{507, "There is room for " + std::to_string(room >> 20) + " MB, and the file has " +
                             std::to_string(bytes >> 20) + " MB. Delete recordings, or use a USB stick."}};
  }
  try {
    const auto upload = std::make_shared<Upload>(folder_ / "spool", bytes);
    const std::lock_guard guard(mutex_);
    upload_ = upload;
    return {std::nullopt, [upload](std::string_view piece) { return upload->take(piece); }};
  } catch (const std::system_error& error) {
    return {Refusal{500, std::string("The file cannot be stored: ") + error.what() + "."}};
  }
}

}  // namespace finsight::page
