#include "firmware/device/saved_state.h"

#include <doctest/doctest.h>
#include <fcntl.h>
#include <unistd.h>

#include <cstdio>
#include <iterator>
#include <map>
#include <thread>
#include <vector>

#include "firmware/input_error.h"
#include "tests/model/scratch_folder.h"

using namespace finsight;

namespace {

/// What save_state() asks of the system, in order.
struct Step {
  enum Kind { kWrite, kSync, kSyncFolder, kRename } kind;
  std::string file, text;  // of a rename: from, to
};
std::vector<Step> steps;
bool watching = false, refuses_sync = false;

std::string name_of(int fd) {
  char name[4096];
  const ssize_t length = ::readlink(("/proc/self/fd/" + std::to_string(fd)).c_str(), name, sizeof name);
  return {name, static_cast<std::size_t>(std::max<ssize_t>(length, 0))};
}

}  // namespace

// The linker puts these before the system's (--wrap).
extern "C" {
ssize_t __real_write(int fd, const void* bytes, std::size_t count);
int __real_fsync(int fd);
int __real_rename(const char* from, const char* to);
ssize_t __wrap_write(int fd, const void* bytes, std::size_t count) {
  if (watching) steps.push_back({Step::kWrite, name_of(fd), {static_cast<const char*>(bytes), count}});
  return __real_write(fd, bytes, count);
}
int __wrap_fsync(int fd) {
  if (refuses_sync) {
    errno = EIO;
    return -1;
  }
  const bool is_folder = std::filesystem::is_directory(name_of(fd));
  if (watching) steps.push_back({is_folder ? Step::kSyncFolder : Step::kSync, name_of(fd), ""});
  return __real_fsync(fd);
}
int __wrap_rename(const char* from, const char* to) {
  if (watching) steps.push_back({Step::kRename, from, to});
  return __real_rename(from, to);
}
}

namespace {

/// Files as the disk holds them after a power cut: what was written and not synced may be there or not.
class Disk {
 public:
  explicit Disk(std::string text, const std::string& file) { names_[file] = {text, text}; }
  void write(const std::string& file, const std::string& bytes) { names_[file].in_memory += bytes; }
  void sync(const std::string& file) { names_[file].on_disk = names_[file].in_memory; }
  void rename(const std::string& from, const std::string& to) {
    names_[to] = names_[from];
    names_.erase(from);
  }
  void create(const std::string& file) { names_[file] = {}; }
  /// What a file holds when only what was synced has survived, or all that was written.
  std::string survivor(const std::string& file, bool only_synced) const {
    const auto found = names_.find(file);
    if (found == names_.end()) return "";
    return only_synced ? found->second.on_disk : found->second.in_memory;
  }

 private:
  struct File {
    std::string in_memory, on_disk;
  };
  std::map<std::string, File> names_;
};

SavedState changed() {
  SavedState state;
  state.settings[kHoldTime] = 1234;
  state.settings[kWordOrder] = 1;
  state.zero.emplace();
  (*state.zero)[kMiddlePlate].displacement_mm = {0.1F, -1.25F, 2.0F / 3};
  (*state.zero)[kLowPlate].rotation_rad = {1e-4F, 0, -0.02F};
  return state;
}

bool same(const SavedState& a, const SavedState& b) {
  if (a.settings != b.settings || a.zero.has_value() != b.zero.has_value()) return false;
  for (std::size_t p = 0; a.zero && p < kPlates; ++p) {
    if ((*a.zero)[p].displacement_mm != (*b.zero)[p].displacement_mm) return false;
    if ((*a.zero)[p].rotation_rad != (*b.zero)[p].rotation_rad) return false;
  }
  return true;
}

std::string text_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

TEST_CASE("saved state: what is saved comes back to the last bit, in a folder that did not exist") {
  const test::ScratchFolder folder;
  const auto file = folder / "deep" / "er" / "state.toml";
  CHECK_FALSE(load_state(file));
  for (const SavedState& state : {SavedState{}, changed()}) {
    save_state(file, state);
    const auto loaded = load_state(file);
    REQUIRE(loaded);
    CHECK(same(*loaded, state));
  }
}

TEST_CASE("saved state: a power cut at any byte leaves the old file or the new one") {
  const test::ScratchFolder folder;
  const auto file = folder / "state.toml", cut = folder / "cut.toml";
  const SavedState old_state;
  save_state(file, old_state);
  const std::string old_text = text_of(file);
  steps.clear();
  watching = true;
  save_state(file, changed());
  watching = false;
  const std::string beside = file.string() + ".new";
  Disk disk(old_text, file.string());
  disk.create(beside);
  int cuts = 0, old_ones = 0, new_ones = 0;
  const auto cut_here = [&] {
    for (const bool only_synced : {false, true}) {
      folder.write("cut.toml", disk.survivor(file.string(), only_synced));
      const auto loaded = load_state(cut);
      REQUIRE(loaded);
      const bool is_old = same(*loaded, old_state), is_new = same(*loaded, changed());
      CHECK(is_old != is_new);
      old_ones += is_old;
      new_ones += is_new;
      ++cuts;
    }
  };
  cut_here();
  std::vector<Step::Kind> kinds;
  for (const Step& step : steps) {
    kinds.push_back(step.kind);
    if (step.kind == Step::kWrite) {
      for (const char byte : step.text) {
        disk.write(step.file, {byte});
        cut_here();
      }
    } else if (step.kind == Step::kSync) {
      disk.sync(step.file);
    } else if (step.kind == Step::kRename) {
      disk.rename(step.file, step.text);
    }
    cut_here();
  }
  CHECK(text_of(file) == disk.survivor(file.string(), true));
  CHECK(kinds.back() == Step::kSyncFolder);
  CHECK(cuts > 2 * static_cast<int>(old_text.size()));
  CHECK(old_ones > 900);
  CHECK(new_ones == 4);  // after the rename, and after the folder's sync
}

TEST_CASE("saved state: a disk that fails leaves the old file, and says so") {
  const test::ScratchFolder folder;
  const auto file = folder / "state.toml";
  save_state(file, {});
  refuses_sync = true;
  CHECK_THROWS_WITH_AS(save_state(file, changed()), doctest::Contains("state.toml: cannot be saved"),
                       std::system_error);
  refuses_sync = false;
  CHECK(same(*load_state(file), {}));
}

TEST_CASE("saved state: a file that is cut, changed or not valid is refused by line and key") {
  const test::ScratchFolder folder;
  const auto file = folder / "state.toml";
  save_state(file, changed());
  const std::string text = text_of(file);
  const auto last_line = text.rfind("low = ");
  for (std::size_t length = 0; length < last_line; ++length) {
    folder.write("state.toml", text.substr(0, length));
    CHECK_THROWS_AS(load_state(file), InputError);
  }
  const auto refusal = [&](const std::string& from, const std::string& to) {
    std::string wrong = text;
    wrong.replace(wrong.find(from), from.size(), to);
    folder.write("state.toml", wrong);
    try {
      load_state(file);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  CHECK(refusal("hold_time = 1234", "hold_time = 10001").find("state.toml:10: settings.hold_time: found 10001") !=
        std::string::npos);
  CHECK(refusal("contact_on = 20", "contact_on = 10").find("\"on\" is not above its \"off\"") != std::string::npos);
  CHECK(refusal("version = 1", "version = 2").find("version: found 2") != std::string::npos);
  CHECK(refusal("light = 1", "lamp = 1").find("light") != std::string::npos);
}

TEST_CASE("saved state: the saver tells how it went, once") {
  const test::ScratchFolder folder;
  const auto wait = [](StateSaver& saver) {
    for (int i = 0; i < 2000; ++i, std::this_thread::sleep_for(std::chrono::milliseconds(5))) {
      if (const auto outcome = saver.outcome()) return *outcome ? 1 : 0;
    }
    return -1;
  };
  {
    StateSaver saver(folder / "state.toml");
    CHECK_FALSE(saver.outcome());
    saver.begin(changed());
    CHECK(wait(saver) == 1);
    CHECK_FALSE(saver.outcome());
  }
  CHECK(same(*load_state(folder / "state.toml"), changed()));
  folder.write("taken", "");
  StateSaver saver(folder / "taken" / "state.toml");  // a file stands where the folder would be
  saver.begin({});
  CHECK(wait(saver) == 0);
}
