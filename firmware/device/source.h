// The source of frames that the settings name: a camera or a recording, what it is seen through, and what a recording
// of it needs to know.
#pragma once

#include <memory>
#include <optional>
#include <variant>

#include "firmware/settings/settings.h"

namespace finsight {

/// Images to observe, or observations that were recorded.
using OpenSource = std::variant<std::unique_ptr<Camera>, std::unique_ptr<PoseReplay>>;

/// Throws InputError for a recording that cannot be used. A camera that is missing is not an error: see
/// open_live_camera().
OpenSource open_source(const Settings& settings);
const SourceStatus& status_of(const OpenSource& source);

/// The lens of the source's images; nothing where plate poses take their place. Throws InputError for a session of
/// markers other than the model's.
std::optional<Lens> source_lens(const Settings& settings, const Model& model);

/// What session.toml says of a recording of this source; nothing for a source without images.
std::optional<SessionInfo> recording_info(const Settings& settings, const Model& model);

/// After this time without a frame clients are told of a fault: six frame times at 60 frames/s, three of a slow camera.
int frame_timeout_ms(const Settings& settings);

}  // namespace finsight
