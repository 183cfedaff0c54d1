// A recorded session -> the touches that a device publishes for it.
#pragma once

#include <filesystem>
#include <vector>

#include "hostgen/fit/touch_reading.h"

namespace finsight::host {

/// The name of a session's folder, also where its path ends with a slash.
std::string session_name(const std::filesystem::path& session);

/// Runs the firmware over a session that begins with the untouched finger: its first second becomes the zero. Readings
/// follow from then on, one per frame. Throws InputError for a session that cannot be read, is not of this finger, or
/// whose finger does not rest at the beginning.
std::vector<TouchReading> session_touches(const std::filesystem::path& session, const Model& model,
                                          const LoopSettings& settings);

}  // namespace finsight::host
