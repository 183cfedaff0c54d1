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
#include "tests/device/open_file.h"
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

}  // namespace

// The linker calls these instead of the system's (--wrap).
extern "C" {
ssize_t __real_write(int fd, const void* bytes, std::size_t count);
int __real_fsync(int fd);
int __real_rename(const char* from, const char* to);
ssize_t __wrap_write(int fd, const void* bytes, std::size_t count) {
  if (watching) steps.push_back({Step::kWrite, test::path_of(fd), {static_cast<const char*>(bytes), count}});
  return __real_write(fd, bytes, count);
}
int __wrap_fsync(int fd) {
  if (refuses_sync) {
    errno = EIO;
    return -1;
  }
  const bool is_folder = std::filesystem::is_directory(test::path_of(fd));
  if (watching) steps.push_back({is_folder ? Step::kSyncFolder : Step::kSync, test::path_of(fd), ""});
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

ZeroBasis basis() {
  ZeroBasis basis{.model_checksum = 0x00C0FFEE, .mount = {}};
  basis.mount.T_finger_camera = Eigen::Translation3d(0, -22, -3) * Eigen::AngleAxisd(-1.5, Eigen::Vector3d::UnitX());
  for (std::size_t p = 0; p < kPlates; ++p) {
    basis.mount.T_finger_marker[p] = Eigen::Translation3d(1, 100 - 30.0 * static_cast<double>(p), 20) *
                                     Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized());
  }
  return basis;
}

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

void save(const std::filesystem::path& file, const SavedState& state) { save_state(file, state, basis()); }

/// For a device with this basis.
std::optional<LoadedState> load(const std::filesystem::path& file, const ZeroBasis& mine = basis()) {
  return load_state(file, &mine);
}

std::string text_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

TEST_CASE("saved state: what is saved is loaded to the last bit, from a folder that did not exist") {
  const test::ScratchFolder folder;
  const auto file = folder / "deep" / "er" / "state.toml";
  CHECK_FALSE(load(file));
  for (const SavedState& state : {SavedState{}, changed()}) {
    save(file, state);
    const auto loaded = load(file);
    REQUIRE(loaded);
    CHECK(same(loaded->state, state));
    CHECK(loaded->problem.empty());
  }
}

TEST_CASE("saved state: a power cut at any byte leaves the old file or the new one") {
  const test::ScratchFolder folder;
  const auto file = folder / "state.toml", cut = folder / "cut.toml";
  const SavedState old_state;
  save(file, old_state);
  const std::string old_text = text_of(file);
  steps.clear();
  watching = true;
  save(file, changed());
  watching = false;
  const std::string beside = file.string() + ".part" + std::to_string(getpid());
  Disk disk(old_text, file.string());
  disk.create(beside);
  int cuts = 0, old_ones = 0, new_ones = 0;
  const auto cut_here = [&] {
    for (const bool only_synced : {false, true}) {
      folder.write("cut.toml", disk.survivor(file.string(), only_synced));
      const auto loaded = load(cut);
      REQUIRE(loaded);
      const bool is_old = same(loaded->state, old_state), is_new = same(loaded->state, changed());
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

TEST_CASE("saved state: when the disk fails, the old file stays and the error names it") {
  const test::ScratchFolder folder;
  const auto file = folder / "state.toml";
  save(file, {});
  refuses_sync = true;
  CHECK_THROWS_WITH_AS(save(file, changed()), doctest::Contains("state.toml: cannot be synced"), std::system_error);
  refuses_sync = false;
  CHECK(same(load(file)->state, {}));
}

TEST_CASE("saved state: a file that is cut or not valid is refused with line and key") {
  const test::ScratchFolder folder;
  const auto file = folder / "state.toml";
  save(file, changed());
  const std::string text = text_of(file);
  const auto last_key = text.rfind(']');
  for (std::size_t length = 0; length <= last_key; ++length) {
    folder.write("state.toml", text.substr(0, length));
    CHECK_THROWS_AS(load(file), InputError);
  }
  const auto refusal = [&](const std::string& from, const std::string& to) {
    std::string wrong = text;
    wrong.replace(wrong.find(from), from.size(), to);
    folder.write("state.toml", wrong);
    try {
      load(file);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  CHECK(refusal("hold_time = 1234", "hold_time = 10001").find("state.toml:10: settings.hold_time: found 10001") !=
        std::string::npos);
  CHECK(refusal("contact_on = 20", "contact_on = 10").find("\"on\" is not above its \"off\"") != std::string::npos);
  CHECK(refusal("version = 5", "version = 6").find("version: found 6") != std::string::npos);
  CHECK(refusal("light = 1", "lamp = 1").find("light") != std::string::npos);
}

TEST_CASE("saved state: the saver reports the outcome of a save once") {
  const test::ScratchFolder folder;
  const auto wait = [](StateSaver& saver) {
    for (int i = 0; i < 2000; ++i, std::this_thread::sleep_for(std::chrono::milliseconds(5))) {
      if (const auto outcome = saver.outcome()) return *outcome ? 1 : 0;
    }
    return -1;
  };
  {
    StateSaver saver(folder / "state.toml", basis());
    CHECK_FALSE(saver.outcome());
    saver.begin(changed());
    CHECK(wait(saver) == 1);
    CHECK_FALSE(saver.outcome());
  }
  CHECK(same(load(folder / "state.toml")->state, changed()));
  folder.write("taken", "");
  StateSaver saver(folder / "taken" / "state.toml", basis());  // a file stands where the folder would be
  saver.begin({});
  CHECK(wait(saver) == 0);
}

TEST_CASE("saved state: a zero of another model or another mount is refused, the settings are used") {
  const test::ScratchFolder folder;
  const auto file = folder / "state.toml";
  save(file, changed());
  const auto refused = [&](const ZeroBasis& mine, const char* reason) {
    const auto loaded = load(file, mine);
    REQUIRE(loaded);
    CHECK(loaded->state.settings == changed().settings);
    CHECK_FALSE(loaded->state.zero);
    CHECK(loaded->problem.find(reason) != std::string::npos);
  };
  ZeroBasis other = basis();
  other.model_checksum = 1;
  refused(other, "was measured with model 00c0ffee, expected 00000001");
  other = basis();
  other.mount.T_finger_camera.translation().z() += 0.01;
  refused(other, "another mount");
  other = basis();
  other.mount.T_finger_marker[kLowPlate].rotate(Eigen::AngleAxisd(1e-4, Eigen::Vector3d::UnitY()));
  refused(other, "another mount");
  ZeroBasis rounded = basis();  // as another compiler computes it
  rounded.mount.T_finger_camera = rounded.mount.T_finger_camera.cast<float>().cast<double>();
  CHECK(load(file, rounded)->state.zero);
}

TEST_CASE("saved state: a zero that is further from rest than any that is measured is not used") {
  const test::ScratchFolder folder;
  const auto is_used = [&](auto change) {
    SavedState state = changed();
    change((*state.zero)[kTopPlate]);
    save(folder / "state.toml", state);
    const auto loaded = load(folder / "state.toml");
    CHECK(loaded->state.settings == state.settings);
    CHECK(loaded->problem.empty() == loaded->state.zero.has_value());
    return loaded->state.zero.has_value();
  };
  CHECK(is_used([](PlateMotion& plate) { plate = {{0, 9.9F, 0}, {0, 0.149F, 0}}; }));
  CHECK_FALSE(is_used([](PlateMotion& plate) { plate.displacement_mm = {9.9F, 9.9F, 9.9F}; }));
  CHECK_FALSE(is_used([](PlateMotion& plate) { plate.rotation_rad = {0, 0, 0.2F}; }));
}

TEST_CASE("saved state: a file without a zero is valid for every model and mount") {
  const test::ScratchFolder folder;
  save(folder / "state.toml", {});
  ZeroBasis other = basis();
  other.model_checksum = 1;
  CHECK(load(folder / "state.toml", other)->problem.empty());
}

TEST_CASE("saved state: of a file of version 1 the settings are used, and its zero is refused") {
  const test::ScratchFolder folder;
  const auto file = folder / "state.toml";
  save(file, changed());
  std::string text = text_of(file);
  text.replace(text.find("version = 5"), 11, "version = 1");
  const std::size_t newer = text.find("master_timeout = ");  // this setting and all behind it came with version 3
  text.erase(newer, text.find("[zero]") - newer);
  folder.write("state.toml", text.substr(0, text.find("model = ")));
  const auto loaded = load(file);
  REQUIRE(loaded);
  RuntimeSettings expected = changed().settings;
  for (int i = kMasterTimeout; i < kSettingCount; ++i) {
    expected.words[static_cast<std::size_t>(i)] = setting_row(i).factory;
  }
  CHECK(loaded->state.settings == expected);
  CHECK_FALSE(loaded->state.zero);
  CHECK(loaded->problem.find("does not say with which model and mount") != std::string::npos);
}

TEST_CASE("saved state: without a model only the settings are loaded; without a usable file they are the factory's") {
  const test::ScratchFolder folder;
  const auto file = folder / "state.toml";
  RuntimeSettings factory;
  factory[kHoldTime] = 777;
  CHECK(load_state_or_factory("", nullptr, factory).state.settings == factory);
  CHECK(load_state_or_factory(file, nullptr, factory).state.settings == factory);
  save(file, changed());
  const LoadedState loaded = load_state_or_factory(file, nullptr, factory);
  CHECK(loaded.state.settings == changed().settings);
  CHECK_FALSE(loaded.state.zero);
  CHECK(loaded.problem.empty());
  folder.write("state.toml", "nonsense\n");
  const LoadedState refused = load_state_or_factory(file, nullptr, factory);
  CHECK(refused.state.settings == factory);
  CHECK(refused.problem.find("state.toml:1: ") != std::string::npos);
  CHECK(refused.problem.find("the factory settings are used") != std::string::npos);
}

TEST_CASE("saved state: the end of the program waits for a save") {
  const test::ScratchFolder folder;
  for (int i = 0; i < 50; ++i) {
    const auto file = folder / ("state" + std::to_string(i) + ".toml");
    StateSaver(file, basis()).begin(changed());
    REQUIRE(load(file));
  }
}

TEST_CASE("saved state: how the finger stood at the zero is kept, where it was known") {
  const test::ScratchFolder folder;
  SavedState state = changed();
  REQUIRE(state.zero);
  state.zero_g = Vec3f(0.25F, -0.75F, 0.5F);
  save(folder / "state.toml", state);
  CHECK(load(folder / "state.toml")->state.zero_g == state.zero_g);
  state.zero_g.reset();
  save(folder / "state.toml", state);
  CHECK_FALSE(load(folder / "state.toml")->state.zero_g);
  CHECK(load(folder / "state.toml")->state.zero);
}
