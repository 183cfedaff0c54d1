#include "firmware/settings/state_text.h"

#include <algorithm>
#include <cstdio>
#include <string>

#include "firmware/input_error.h"
#include "firmware/model/model.h"

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

/// As near as Zeroing takes one, and a hundredth for rounding.
bool is_near_rest(const ZeroPose& zero, float furthest_mm) {
  constexpr float kSlack = 1.01F;
  return std::ranges::all_of(zero, [&](const PlateMotion& plate) {
    return plate.displacement_mm.norm() <= kSlack * furthest_mm &&
           plate.rotation_rad.norm() <= kSlack * Zeroing::kMaxRotation_rad;
  });
}

/// Why the zero cannot be used; empty if it can.
std::string mismatch(const StoredZero& zero, const ZeroBasis& basis) {
  if (zero.model.empty()) return "does not say with which model and mount it was measured";
  if (zero.model != checksum_text(basis.model_checksum)) {
    return "was measured with model " + zero.model + ", expected " + checksum_text(basis.model_checksum);
  }
  if (!is_same_mount(zero.mount, basis.mount)) return "was measured with another mount of camera and markers";
  return is_near_rest(zero.pose, basis.furthest_mm) ? ""
                                                    : "is further from the finger's rest than any that is measured";
}

void add_numbers(std::string& text, const PlateMotion& motion) {
  for (int i = 0; i < 6; ++i) {
    char number[32];
    const double value = static_cast<double>(i < 3 ? motion.displacement_mm[i] : motion.rotation_rad[i - 3]);
    std::snprintf(number, sizeof number, "%s%.9g", i ? ", " : "", value);
    text += number;
  }
}

}  // namespace

std::string state_text(const RuntimeSettings& settings, const std::optional<ZeroPose>& zero,
                       const std::optional<Vec3f>& zero_g, std::uint32_t model_checksum, const MeasuredMount& mount) {
  std::string text = "# Written by finsightd when a client saves; without this file the factory settings are used.\n";
  text.append("version = ").append(std::to_string(kStateVersion)).append("\n[settings]\n");
  for (int i = 0; i < kSettingCount; ++i) {
    const std::string value = std::to_string(settings.words[static_cast<std::size_t>(i)]);
    text.append(setting_row(i).name).append(" = ").append(value).append("\n");
  }
  text.append("[zero]\nset = ").append(zero ? "true" : "false").append("\n");
  if (!zero) return text;
  for (std::size_t p = 0; p < kPlates; ++p) {
    text.append(kPlateNames[p]).append(" = [");
    add_numbers(text, (*zero)[p]);
    text.append("]  # mm, rad\n");
  }
  if (zero_g) {
    char line[96];
    const Eigen::Vector3d g = zero_g->cast<double>();
    std::snprintf(line, sizeof line, "gravity_g = [%.9g, %.9g, %.9g]  # when it was measured\n", g.x(), g.y(), g.z());
    text += line;
  }
  text.append("model = \"").append(checksum_text(model_checksum));
  text.append("\"  # that it was measured with, and the mount\n");
  return text.append(measured_mount_toml(mount, "zero.mount."));
}

LoadedState read_state(TomlTable root, const std::string& where, const ZeroBasis* basis) {
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
    loaded.problem = where + ": the saved zero is not used: it " + reason + "; zero the finger and save again";
  }
  return loaded;
}

}  // namespace finsight
