// Where the camera of a session sees the markers of a finger at rest.
#pragma once

#include <filesystem>

#include "firmware/calibrate/mount_estimate.h"

namespace finsight::host {

/// Throws InputError for a session of other markers than `mount` has, in which fewer than ten frames show all three, or
/// in which one moves.
RestingCorners resting_corners(const std::filesystem::path& session, const MountModel& mount);

}  // namespace finsight::host
