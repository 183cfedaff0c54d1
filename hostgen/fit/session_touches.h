// A recorded session -> the touches that a device publishes for it.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "hostgen/fit/touch_reading.h"

namespace finsight::host {

/// The name of a session's folder, also where its path ends with a slash.
std::string session_name(const std::filesystem::path& session);

struct SessionTouches {
  std::vector<TouchReading> readings;  ///< one per frame, from the second second on
  ZeroPose zero;                       ///< that they are relative to
  float left_mm = 0;                   ///< how far a plate stood from the earlier zero at the beginning, at most
};

/// Runs the firmware over a session that begins with the untouched finger. Its first second becomes the zero, unless
/// `earlier` is the same finger's zero before it was touched and the plates are still within `left_by_touches_mm` of
/// it: what touches have left in the finger is no rest pose. Throws InputError for a session that cannot be read, is
/// not of this finger, or whose finger does not rest at the beginning.
SessionTouches session_touches(const std::filesystem::path& session, const Model& model, const LoopSettings& settings,
                               const std::optional<ZeroPose>& earlier, float left_by_touches_mm = 1);

}  // namespace finsight::host
