#include "firmware/device/source.h"

#include <algorithm>

#include "firmware/device/log.h"

namespace finsight {

namespace {

void report_if_cut(const std::filesystem::path& session) {
  if (read_session_info(session).complete) return;
  const Y4mReader images(session / kSessionFrames, true);
  log_message(session.string() + ": this recording was cut off; its " + std::to_string(images.whole_frames()) +
              " whole frames are replayed");
}

}  // namespace

OpenSource open_source(const Settings& settings) {
  switch (settings.source) {
    case Settings::Source::kSession:
      report_if_cut(settings.replay.path);
      return open_session_camera(settings.replay);
    case Settings::Source::kPoses:
      return open_pose_replay(settings.replay);
    case Settings::Source::kCamera:
      break;
  }
  return open_live_camera(settings.camera, log_message);
}

const SourceStatus& status_of(const OpenSource& source) {
  return std::visit([](const auto& opened) -> const SourceStatus& { return *opened; }, source);
}

std::optional<Lens> source_lens(const Settings& settings, const Model& model) {
  if (settings.source == Settings::Source::kCamera) return settings.lens;
  if (settings.source == Settings::Source::kPoses) return std::nullopt;
  const SessionInfo info = read_session_info(settings.replay.path);
  check_markers(info, settings.replay.path, model.mount.marker_id, static_cast<double>(model.mount.marker_size_mm),
                "the model pack");
  return info.lens;
}

std::optional<SessionInfo> recording_info(const Settings& settings, const Model& model) {
  if (settings.source == Settings::Source::kPoses) return std::nullopt;
  if (settings.source == Settings::Source::kSession) return read_session_info(settings.replay.path);
  SessionInfo info;
  info.lens = settings.lens;
  info.frames_per_second = settings.camera.frames_per_second;
  info.marker_dictionary = "DICT_4X4_50";
  info.marker_id = model.mount.marker_id;
  info.marker_size_mm = static_cast<double>(model.mount.marker_size_mm);
  return info;
}

int frame_timeout_ms(const Settings& settings) {
  const bool is_live = settings.source == Settings::Source::kCamera;
  return std::max(100, is_live ? static_cast<int>(3000 / settings.camera.frames_per_second) : 0);
}

}  // namespace finsight
