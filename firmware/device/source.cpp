#include "firmware/device/source.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "firmware/device/log.h"
#include "firmware/input_error.h"

namespace finsight {

std::unique_ptr<Camera> open_source(const Settings& settings) {
  switch (settings.source) {
    case Settings::Source::kSession:
      return open_session_camera(settings.replay);
    case Settings::Source::kPoses:
      return open_pose_camera(settings.replay);
    case Settings::Source::kCamera:
      break;
  }
  return open_live_camera(settings.camera, log_message);
}

std::optional<CameraModel> source_lens(const Settings& settings, const Model& model) {
  if (settings.source == Settings::Source::kCamera) return settings.lens;
  if (settings.source == Settings::Source::kPoses) return std::nullopt;
  const SessionInfo info = read_session_info(settings.replay.path);
  const std::string file = (settings.replay.path / kSessionInfo).string();
  if (info.marker_id != model.mount.marker_id) throw InputError(file, "marker ids are not those of the model pack");
  const auto size_mm = static_cast<double>(model.mount.marker_size_mm);
  if (std::abs(info.marker_size_mm - size_mm) > 0.001 * size_mm) {
    throw InputError(file, "markers.size_mm", std::to_string(info.marker_size_mm),
                     std::to_string(size_mm) + ", as in the model pack");
  }
  return camera_of(info);
}

std::optional<SessionInfo> recording_info(const Settings& settings, const Model& model) {
  if (settings.source == Settings::Source::kPoses) return std::nullopt;
  if (settings.source == Settings::Source::kSession) return read_session_info(settings.replay.path);
  const CameraModel& lens = settings.lens;
  SessionInfo info;
  info.width_px = settings.camera.width_px;
  info.height_px = settings.camera.height_px;
  info.frames_per_second = settings.camera.frames_per_second;
  info.fx_fy_cx_cy = {lens.fx, lens.fy, lens.cx, lens.cy};
  info.k1_k2_p1_p2_k3 = {lens.k1, lens.k2, lens.p1, lens.p2, lens.k3};
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
