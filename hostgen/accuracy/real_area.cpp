// Area real: networks on the recordings of a real finger.
#include <nlohmann/json.hpp>

#include "hostgen/accuracy/areas.h"
#include "hostgen/recordings/audit.h"
#include "hostgen/recordings/pen_distance.h"
#include "hostgen/recordings/recording_training.h"

namespace finsight::host {

using nlohmann::json;

json measure_real(const Model& model, const std::filesystem::path& recordings, const std::filesystem::path& folder,
                  bool quick) {
  if (recordings.empty()) return {{"real", {{"why", "FINSIGHT_DATA names no recordings"}}}};
  json real;
  const RecordedMotion motion = read_recorded_motion(recordings, "");
  const RecordingAudit audit = audit_recordings(motion);
  plot_audit(audit, motion, folder / "recordings.svg");
  real["audit"] = {{"rows", audit.rows},
                   {"contact_points", audit.contact_points},
                   {"repeated", audit.repeated},
                   {"leaked", audit.leaked},
                   {"outliers", audit.outliers.size()},
                   {"rotation_change_deg", audit.change_deg},
                   {"touch_follows_pose_mm", audit.pen_residual_mm}};
  const PenDistance pen = measure_pen_distance(motion, model, quick ? 500 : 5000);
  real["pen_distance_mm"] = pen.mean_mm;
  real["pen_distance"] = {{"error_95_mm", pen.error_95_mm}, {"unbent_mean_mm", pen.rest_mean_mm}, {"rows", pen.rows}};
  for (const RecordingScore& score : train_on_recordings(motion, &model, {.steps = quick ? 200 : 20000})) {
    const auto errors = [](const AxisErrors& axes) { return json{{"rmse_mm", axes.rmse_mm}, {"r2", axes.r2}}; };
    real["methods"][score.method] = {
        {"random", errors(score.random)}, {"by_contact_point", errors(score.by_point)}, {"mean_mm", score.mean_mm}};
    if (score.method != "history") continue;
    real["random"] = errors(score.random);
    real["by_contact_point"] = errors(score.by_point);
  }
  return {{"real", real}};
}

}  // namespace finsight::host
