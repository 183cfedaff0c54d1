#include "hostgen/calibrate/resting_corners.h"

#include "firmware/input_error.h"
#include "firmware/ports/camera.h"
#include "firmware/vision/marker_stage.h"
#include "hostgen/util/common.h"

namespace finsight::host {

RestingCorners resting_corners(const std::filesystem::path& session, const MountModel& mount) {
  const SessionInfo info = read_session_info(session);
  check_markers(info, session, mount.marker_id, static_cast<double>(mount.marker_size_mm), "the finger spec");
  MarkerStage markers(mount, info.lens);
  const auto camera = open_session_camera({.path = session, .recording = "", .recorded_speed = false}, info);
  RestingCornersSum sum;
  Frame frame;
  while (camera->next(frame, 0)) {
    if (interrupted()) throw Interrupted();
    sum.add(markers.find(frame));
  }
  if (!camera->error().empty()) throw InputError(session.string(), camera->error());
  return sum.mean(info.lens, session.string());
}

}  // namespace finsight::host
