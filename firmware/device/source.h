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

/// What the source's images are like: session.toml's contents for a recorded session, and those of a new recording for
/// a camera; nothing for recorded plate poses, which have no images. Throws InputError for a session of markers other
/// than the model's.
std::optional<SessionInfo> source_images(const Settings& settings, const Model& model);

/// What is known of the finger's attitude and rest: from the board file, or else from the session. Recorded plate
/// motions are relative to their own rest.
void complete_from_source(const Settings& settings, const std::optional<SessionInfo>& images, LoopSettings& loop);

/// `images`: source_images(). Throws InputError for a recording that cannot be used. A camera that is missing is not an
/// error: see open_live_camera().
OpenSource open_source(const Settings& settings, const std::optional<SessionInfo>& images);
const SourceStatus& status_of(const OpenSource& source);

/// After this time without a frame clients are told of a fault: six frame times at 60 frames/s, three of a slow camera.
int frame_timeout_ms(const Settings& settings);

}  // namespace finsight
