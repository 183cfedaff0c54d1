// The text of the file that holds what clients changed and saved: settings and zero. finsightd writes it when a client
// saves, the page when one is imported.
#pragma once

#include <optional>
#include <string>

#include "firmware/loop/zero.h"
#include "firmware/modbus/registers.h"
#include "firmware/settings/measured_mount.h"
#include "firmware/settings/toml_table.h"

namespace finsight {

inline constexpr int kStateVersion = 5;  ///< a new one when the keys change

struct SavedState {
  RuntimeSettings settings;
  std::optional<ZeroPose> zero;
  /// Acceleration of things that fell when the zero was measured, if known.
  std::optional<Vec3f> zero_g = std::nullopt;
};

/// What a zero was measured with. It is meaningless for another finger, and once camera or markers sit elsewhere.
struct ZeroBasis {
  std::uint32_t model_checksum = 0;
  MeasuredMount mount;
  float furthest_mm = 10;  ///< that a zero may be from the model's rest, as in Zeroing
};

struct LoadedState {
  SavedState state;
  std::string problem;  ///< what was not used, and why; empty: nothing
};

/// `zero_g`: acceleration of things that fell when the zero was measured, if known. Checksum and mount: of what the
/// zero was measured with.
std::string state_text(const RuntimeSettings& settings, const std::optional<ZeroPose>& zero,
                       const std::optional<Vec3f>& zero_g, std::uint32_t model_checksum, const MeasuredMount& mount);

/// Strict: throws InputError like TomlTable. A zero of another basis or further from rest than any that is measured is
/// left out, and so is one of a version 1 file, which does not say its basis; the settings are used all the same.
/// Without `basis` (there is no model) any zero is left out, and that is no problem. `where`: the file, for messages.
LoadedState read_state(TomlTable root, const std::string& where, const ZeroBasis* basis);

}  // namespace finsight
