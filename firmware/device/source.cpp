#include "firmware/device/source.h"

#include <algorithm>

#include "firmware/device/log.h"

namespace finsight {

namespace {

void report_if_cut(const std::string& finger, const std::filesystem::path& session, const SessionInfo& info) {
  if (info.complete) return;
  const Y4mReader images(session / kSessionFrames, true);
  log_message(finger, session.string() + ": this recording was cut off; its " + std::to_string(images.whole_frames()) +
                          " whole frames are replayed");
}

}  // namespace

std::optional<SessionInfo> source_images(const Settings& settings, const Model& model) {
  const auto marker_size_mm = static_cast<double>(model.mount.marker_size_mm);
  switch (settings.source) {
    case Settings::Source::kPoses:
      return std::nullopt;
    case Settings::Source::kSession: {
      SessionInfo info = read_session_info(settings.replay.path);
      check_markers(info, settings.replay.path, model.mount.marker_id, marker_size_mm, "the model pack");
      if (info.readout_ms > 0 && !settings.replay.recorded_speed) {
        throw InputError((settings.replay.path / kSessionInfo).string(), "readout_ms", std::to_string(info.readout_ms),
                         "a session of a global shutter, or speed = \"recorded\" in the board file: at full speed "
                         "frames have no times from which to tell how fast markers move");
      }
      if (!settings.measured_lens.empty()) {
        info.lens = read_lens(TomlTable::parse_file(settings.measured_lens), info.lens.width_px, info.lens.height_px);
      }
      return info;
    }
    case Settings::Source::kCamera:
      break;
  }
  return SessionInfo{.lens = settings.lens,
                     .frames_per_second = settings.camera.frames_per_second,
                     .marker_dictionary = "DICT_4X4_50",
                     .marker_id = model.mount.marker_id,
                     .marker_size_mm = marker_size_mm,
                     .description = {},
                     .gravity_g = settings.fixed_g,
                     .coding = settings.camera.coding_or_linear(),
                     .readout_ms = settings.camera.readout_ms.value_or(0)};
}

void complete_from_source(const Settings& settings, const std::optional<SessionInfo>& images, LoopSettings& loop) {
  const bool is_recorded_motion = settings.source == Settings::Source::kPoses;
  loop.rest_is_known = is_recorded_motion || images->from_rest;
  if (images) loop.readout_ms = images->readout_ms;
  if (settings.source == Settings::Source::kCamera && !settings.camera.coding) {
    log_message(
        settings.name,
        "coding is not told (board file, [source]): grey levels are taken for linear; of a camera that codes them for "
        "the eye, as webcams do, touches are only right after a zero");
  }
  if (settings.source == Settings::Source::kCamera && !settings.camera.readout_ms) {
    log_message(
        settings.name,
        "readout_ms is not told (board file, [source]): taken for a camera with a global shutter; behind a rolling "
        "one touches of a finger that moves fast are less sure than they say");
  }
  loop.fixed_g = settings.fixed_g;
  if (settings.fixed_g || settings.gravity_max_age_ms > 0) return;
  loop.fixed_g = is_recorded_motion ? std::optional(Vec3f(0, 0, 0)) : images->gravity_g;
  if (loop.fixed_g) return;
  log_message(
      settings.name,
      "gravity is not known (board file, [gravity]): every touch is told less surely, as if the finger had turned");
}

OpenSource open_source(const Settings& settings, const std::optional<SessionInfo>& images) {
  switch (settings.source) {
    case Settings::Source::kSession:
      report_if_cut(settings.name, settings.replay.path, images.value());
      return open_session_camera(settings.replay, *images);
    case Settings::Source::kPoses:
      return open_pose_replay(settings.replay);
    case Settings::Source::kCamera:
      break;
  }
  return open_live_camera(settings.camera,
                          [name = settings.name](const std::string& text) { log_message(name, text); });
}

const SourceStatus& status_of(const OpenSource& source) {
  return std::visit([](const auto& opened) -> const SourceStatus& { return *opened; }, source);
}

int frame_timeout_ms(const Settings& settings) {
  const bool is_live = settings.source == Settings::Source::kCamera;
  return std::max(100, is_live ? static_cast<int>(3000 / settings.camera.frames_per_second) : 0);
}

}  // namespace finsight
