#include "hostgen/fit/session_touches.h"

#include <cmath>

#include "firmware/input_error.h"
#include "firmware/modbus/register_table.h"
#include "firmware/ports/camera.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

constexpr std::int64_t kFirstFrame_ns = 1'000'000'000;  // 0 stands for no frame

float motion_between_mm(const ZeroPose& before, const ZeroPose& now) {
  const PoseVector moved = pose_vector({.plates = now}) - pose_vector({.plates = before});
  return plate_motion_mm(moved);
}

}  // namespace

TouchReading touch_reading(const FrameLoop& loop, double time_s) {
  const RegisterImage& image = loop.registers();
  TouchReading reading{.time_s = time_s};
  reading.plate_motion_mm = plate_motion_mm(loop.view().poses.plates);
  reading.explained = loop.view().explained;
  reading.poses = loop.view().poses;
  reading.is_valid = image.words[address_of("status")] & kTouchValid;
  if (!reading.is_valid) return reading;
  for (int i = 0; i < 3; ++i) {
    reading.point_mm[i] = static_cast<float>(measured_value(image, address_of("touch_x") + i));
  }
  reading.radius_mm = measured_value(image, address_of("touch_uncertainty"));
  reading.force_n = measured_value(image, address_of("force"));
  reading.force_sigma_n = measured_value(image, address_of("force_uncertainty"));
  return reading;
}

std::string session_name(const std::filesystem::path& session) {
  return session.has_filename() ? session.filename().string() : session.parent_path().filename().string();
}

SessionTouches session_touches(const std::filesystem::path& session, const Model& model, const LoopSettings& settings,
                               const std::optional<ZeroPose>& earlier, float left_by_touches_mm) {
  const SessionInfo info = read_session_info(session);
  check_markers(info, session, model.mount.marker_id, static_cast<double>(model.mount.marker_size_mm),
                "the model pack");
  LoopSettings loop_settings = settings;
  loop_settings.shape.tier = ShapeSettings::Tier::kMeasures;
  loop_settings.readout_ms = info.readout_ms;
  loop_settings.fixed_g = Vec3f(0, 0, 0);  // a jig keeps the finger as it was at its zero
  FrameLoop loop(model, info.lens, loop_settings);
  const auto camera = open_session_camera({.path = session, .recording = "", .recorded_speed = false}, info);
  SessionTouches touches;
  bool is_zeroed = false;
  loop.zeroing().begin();
  Frame frame;
  for (std::int64_t number = 0; camera->next(frame, 0); ++number) {
    if (interrupted()) throw Interrupted();
    // The camera gives frames as fast as they are asked for; creep and swings take their time by the recording's clock.
    const double time_s = static_cast<double>(number) / info.frames_per_second;
    frame.exposure_ns = kFirstFrame_ns + std::llround(1e9 * time_s);
    loop.step(frame);
    if (is_zeroed) touches.readings.push_back(touch_reading(loop, time_s));
    const auto outcome = loop.zeroing().take_outcome();
    if (!outcome) continue;
    is_zeroed = *outcome;
    if (!is_zeroed) {
      throw InputError(session.string(), "does not begin with an untouched finger that stands still for a second");
    }
    touches.zero = *loop.zeroing().zero();
    if (!earlier) continue;
    touches.left_mm = motion_between_mm(*earlier, touches.zero);
    if (touches.left_mm < left_by_touches_mm) {
      loop.zeroing().set_zero(touches.zero = *earlier);
    }
  }
  if (!camera->error().empty()) throw InputError(session.string(), camera->error());
  if (touches.readings.empty())
    throw InputError(session.string(), "is over before the finger was zeroed, after one second");
  return touches;
}

}  // namespace finsight::host
