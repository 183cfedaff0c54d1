// Whole-frame time from pixels to registers.
#include <nlohmann/json.hpp>

#include "firmware/frame_loop.h"
#include "firmware/ports/camera.h"
#include "firmware/settings.h"
#include "hostgen/common.h"
#include "hostgen/report/areas.h"

namespace finsight::host {

using nlohmann::json;

json measure_vision(const Model& model, const std::filesystem::path& session, bool quick) {
  FrameLoop loop(model, camera_of(read_session_info(session)), LoopSettings{});
  const auto camera = open_session_camera({.path = session, .recording = "", .recorded_speed = false, .repeat = false});
  Frame frame;
  const std::uint64_t most = quick ? 300 : 100000;
  while (loop.times().frame.count() < most && camera->next(frame, 1000)) {
    if (interrupted()) throw Interrupted();
    loop.step(frame);
  }
  const StageTimes& times = loop.times();
  return {{"vision",
           {{"frame_ms_p50", times.frame.percentile_us(0.5) / 1000},
            {"frame_ms_p99", times.frame.percentile_us(0.99) / 1000},
            {"poses_ms_p50", times.poses.percentile_us(0.5) / 1000},
            {"frames", times.frame.count()},
            {"why", "presets lab, factory and worst are not built yet"}}}};
}

}  // namespace finsight::host
