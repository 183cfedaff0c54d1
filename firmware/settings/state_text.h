// The text of the file that holds what clients changed and saved: settings and zero. finsightd writes it when a client
// saves, the page when one is imported; load_state() in device/saved_state.h reads it.
#pragma once

#include <optional>
#include <string>

#include "firmware/modbus/registers.h"
#include "firmware/settings/measured_mount.h"

namespace finsight {

inline constexpr int kStateVersion = 5;  ///< a new one when the keys change

/// `zero_g`: acceleration of things that fell when the zero was measured, if known. Checksum and mount: of what the
/// zero was measured with.
std::string state_text(const RuntimeSettings& settings, const std::optional<ZeroPose>& zero,
                       const std::optional<Vec3f>& zero_g, std::uint32_t model_checksum, const MeasuredMount& mount);

}  // namespace finsight
