#include "firmware/device/saved_state.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <system_error>
#include <utility>

#include "firmware/input_error.h"
#include "firmware/settings/toml_table.h"

namespace finsight {

namespace {

constexpr int kVersion = 1;  // of the file; another one when settings are added

void add_numbers(std::string& text, const PlateMotion& motion) {
  for (int i = 0; i < 6; ++i) {
    char number[32];
    const double value = static_cast<double>(i < 3 ? motion.displacement_mm[i] : motion.rotation_rad[i - 3]);
    std::snprintf(number, sizeof number, "%s%.9g", i ? ", " : "", value);
    text += number;
  }
}

std::string text_of(const SavedState& state) {
  std::string text =
      "# Written by finsightd when a client saves; deleting it brings the factory settings back.\nversion = " +
      std::to_string(kVersion) + "\n[settings]\n";
  for (int i = 0; i < kSettingCount; ++i) {
    text += std::string(setting_row(i).name) + " = " +
            std::to_string(state.settings.words[static_cast<std::size_t>(i)]) + "\n";
  }
  text += "[zero]\nset = " + std::string(state.zero ? "true" : "false") + "\n";
  if (!state.zero) return text;
  for (std::size_t p = 0; p < kPlates; ++p) {
    text += std::string(kPlateNames[p]) + " = [";
    add_numbers(text, (*state.zero)[p]);
    text += "]  # mm, rad\n";
  }
  return text;
}

std::optional<ZeroPose> read_zero(TomlTable table) {
  ZeroPose zero;
  const bool is_set = table.flag("set");
  if (is_set) {
    for (std::size_t p = 0; p < kPlates; ++p) {
      const auto numbers = table.numbers(kPlateNames[p], 6, -10, 10);
      for (int i = 0; i < 6; ++i) {
        Vec3f& part = i < 3 ? zero[p].displacement_mm : zero[p].rotation_rad;
        part[i % 3] = static_cast<float>(numbers[static_cast<std::size_t>(i)]);
      }
    }
  }
  table.finish();
  return is_set ? std::optional(zero) : std::nullopt;
}

/// Closes at the end of its block.
struct File {
  File(const std::string& name, int flags) : fd(::open(name.c_str(), flags | O_CLOEXEC, 0640)) {}
  ~File() {
    if (fd >= 0) ::close(fd);
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;
  int fd;
};

}  // namespace

std::optional<SavedState> load_state(const std::filesystem::path& file) {
  if (!std::filesystem::exists(file)) return std::nullopt;
  TomlTable root = TomlTable::parse_file(file);
  root.integer("version", kVersion, kVersion);
  SavedState state;
  TomlTable table = root.table("settings");
  for (int i = 0; i < kSettingCount; ++i) {
    const RegisterRow& row = setting_row(i);
    state.settings.words[static_cast<std::size_t>(i)] =
        static_cast<std::uint16_t>(table.integer(row.name, row.lowest, row.highest));
  }
  if (!are_valid(state.settings)) throw InputError(table.where(), "a threshold's \"on\" is not above its \"off\"");
  table.finish();
  state.zero = read_zero(root.table("zero"));
  root.finish();
  return state;
}

void save_state(const std::filesystem::path& file, const SavedState& state) {
  const auto require = [&file](bool done) {
    if (!done) throw std::system_error(errno, std::generic_category(), file.string() + ": cannot be saved");
  };
  const std::filesystem::path folder = file.has_parent_path() ? file.parent_path() : ".";
  std::filesystem::create_directories(folder);
  const std::string text = text_of(state), beside = file.string() + ".new";
  {
    const File written(beside, O_WRONLY | O_CREAT | O_TRUNC);
    require(written.fd >= 0);
    std::size_t done = 0;
    while (done < text.size()) {
      const ssize_t count = ::write(written.fd, text.data() + done, text.size() - done);
      require(count > 0 || (count < 0 && errno == EINTR));
      if (count > 0) done += static_cast<std::size_t>(count);
    }
    require(::fsync(written.fd) == 0);
  }
  require(::rename(beside.c_str(), file.c_str()) == 0);
  // The new name itself is on the disk once the folder is.
  const File entry(folder.string(), O_RDONLY | O_DIRECTORY);
  require(entry.fd >= 0 && ::fsync(entry.fd) == 0);
}

StateSaver::StateSaver(std::filesystem::path file) : file_(std::move(file)), thread_([this] { run(); }) {}

StateSaver::~StateSaver() {
  stopping_ = true;
  work_.release();
  thread_.join();
}

void StateSaver::begin(const SavedState& state) {
  state_ = state;
  progress_ = Progress::kSaving;
  work_.release();
}

std::optional<bool> StateSaver::outcome() {
  const Progress progress = progress_;
  if (progress != Progress::kSaved && progress != Progress::kFailed) return std::nullopt;
  progress_ = Progress::kIdle;
  return progress == Progress::kSaved;
}

void StateSaver::run() {
  for (;;) {
    work_.acquire();
    if (progress_ == Progress::kSaving) {
      try {
        save_state(file_, state_);
        progress_ = Progress::kSaved;
      } catch (const std::exception& error) {
        std::fprintf(stderr, "finsightd: %s\n", error.what());
        progress_ = Progress::kFailed;
      }
    }
    if (stopping_) return;
  }
}

}  // namespace finsight
