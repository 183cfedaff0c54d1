#include "firmware/device/saved_state.h"

#include <utility>

#include "firmware/device/log.h"
#include "firmware/input_error.h"
#include "firmware/model/model.h"
#include "firmware/settings/atomic_file.h"
#include "firmware/settings/state_text.h"
#include "firmware/settings/toml_table.h"

namespace finsight {

namespace {

// Of the file. Version 1 did not say what the zero was measured with; versions 2 and 4 had fewer settings than the one
// after them; up to version 3 a zero did not say how the finger stood.
constexpr int kVersionWithoutBasis = 1;

bool had_setting(std::int64_t version, int setting) {
  if (version <= 4 && setting >= kVerifiedOn && setting <= kVerifyEvery) return false;
  return version > 2 || setting <= kTriggerCommand;
}

/// Those that the file's version did not have yet get their factory values.
RuntimeSettings read_settings_table(TomlTable table, std::int64_t version) {
  RuntimeSettings settings;
  for (int i = 0; i < kSettingCount; ++i) {
    const RegisterRow& row = setting_row(i);
    if (!had_setting(version, i) && !table.has(row.name)) continue;
    settings.words[static_cast<std::size_t>(i)] =
        static_cast<std::uint16_t>(table.integer(row.name, row.lowest, row.highest));
  }
  if (!are_valid(settings)) throw InputError(table.where(), "a threshold's \"on\" is not above its \"off\"");
  table.finish();
  return settings;
}

struct StoredZero {
  ZeroPose pose;
  std::optional<Vec3f> gravity_g;
  std::string model;    ///< checksum_text(); empty in a file of version 1
  MeasuredMount mount;  ///< only with a model
};

std::optional<StoredZero> read_zero(TomlTable table, bool has_basis) {
  StoredZero zero;
  const bool is_set = table.flag("set");
  if (is_set) {
    for (std::size_t p = 0; p < kPlates; ++p) {
      const auto numbers = table.numbers(kPlateNames[p], 6, -10, 10);
      for (int i = 0; i < 6; ++i) {
        Vec3f& part = i < 3 ? zero.pose[p].displacement_mm : zero.pose[p].rotation_rad;
        part[i % 3] = static_cast<float>(numbers[static_cast<std::size_t>(i)]);
      }
    }
  }
  if (is_set && table.has("gravity_g")) {
    const auto g = table.numbers("gravity_g", 3, -100, 100);
    zero.gravity_g = Eigen::Vector3d(g[0], g[1], g[2]).cast<float>();
  }
  if (is_set && has_basis) {
    zero.model = table.text("model");
    zero.mount = read_measured_mount(table.table("mount"));
  }
  table.finish();
  return is_set ? std::optional(zero) : std::nullopt;
}

/// Why the zero cannot be used; empty if it can.
std::string mismatch(const StoredZero& zero, const ZeroBasis& basis) {
  if (zero.model.empty()) return "does not say with which model and mount it was measured";
  if (zero.model != checksum_text(basis.model_checksum)) {
    return "was measured with model " + zero.model + ", expected " + checksum_text(basis.model_checksum);
  }
  if (!is_same_mount(zero.mount, basis.mount)) return "was measured with another mount of camera and markers";
  return "";
}

}  // namespace

std::optional<LoadedState> load_state(const std::filesystem::path& file, const ZeroBasis* basis) {
  if (!std::filesystem::exists(file)) return std::nullopt;
  TomlTable root = TomlTable::parse_file(file);
  const auto version = root.integer("version", kVersionWithoutBasis, kStateVersion);
  LoadedState loaded{{read_settings_table(root.table("settings"), version), std::nullopt, std::nullopt}, ""};
  const auto zero = read_zero(root.table("zero"), version != kVersionWithoutBasis);
  root.finish();
  if (!zero || !basis) return loaded;
  const std::string reason = mismatch(*zero, *basis);
  if (reason.empty()) {
    loaded.state.zero = zero->pose;
    loaded.state.zero_g = zero->gravity_g;
  } else {
    loaded.problem = file.string() + ": the saved zero is not used: it " + reason + "; zero the finger and save again";
  }
  return loaded;
}

LoadedState load_state_or_factory(const std::filesystem::path& file, const ZeroBasis* basis,
                                  const RuntimeSettings& factory) {
  const LoadedState unsaved{{factory, std::nullopt}, ""};
  if (file.empty()) return unsaved;
  try {
    return load_state(file, basis).value_or(unsaved);
  } catch (const InputError& error) {
    return {unsaved.state, std::string(error.what()) + "; the factory settings are used"};
  }
}

void save_state(const std::filesystem::path& file, const SavedState& state, const ZeroBasis& basis) {
  write_file_atomically(file, state_text(state.settings, state.zero, state.zero_g, basis.model_checksum, basis.mount));
}

StateSaver::StateSaver(std::filesystem::path file, ZeroBasis basis)
    : file_(std::move(file)), basis_(std::move(basis)), thread_([this] { run(); }) {}

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
        save_state(file_, state_, basis_);
        progress_ = Progress::kSaved;
      } catch (const std::exception& error) {
        log_message(error.what());
        progress_ = Progress::kFailed;
      }
    }
    if (stopping_) return;
  }
}

}  // namespace finsight
