#include "hostgen/accuracy/touch_map.h"

#include <map>
#include <nlohmann/json.hpp>

#include "firmware/touch/touch_stage.h"
#include "hostgen/learn/touch_samples.h"
#include "hostgen/util/random.h"
#include "hostgen/util/statistics.h"

namespace finsight::host {

using nlohmann::json;

namespace {

constexpr double kMotionBands_mm[] = {0, 2, 4, 7, 12};  // of plate motion
constexpr int kRadii = 30;
constexpr std::uint64_t kMapSeed = 68;

struct Point {
  Vec3f point_mm = Vec3f::Zero();
  int trials = 0;
  std::vector<double> errors_mm;
};

struct MotionBand {
  int touches = 0;
  std::array<int, kRadii> inside = {};
};

double band_of(double motion_mm) {
  double from_mm = 0;
  for (const double edge : kMotionBands_mm) {
    if (motion_mm >= edge) from_mm = edge;
  }
  return from_mm;
}

}  // namespace

json map_touches(const Model& model, const FingerSpec& spec, const FemDataset& unseen, int draws) {
  TouchStage stage(model);
  stage.use_tolerances(0, 0, 0);  // the states are of the finger that the pack was made for
  Random random(kMapSeed);
  std::map<std::int32_t, Point> points;
  std::map<double, MotionBand> bands;
  for (const FemState& state : unseen.states) {
    if (!state.valid()) continue;
    for (int draw = 0; draw < draws; ++draw) {
      PoseVector motion = pose_vector({.plates = state.plates, .seen = {true, true, true}});
      add_noise(spec.noise, random, motion);
      const Touch touch = stage.locate(seen_poses({motion.data(), kPoseDims}));
      Point& point = points[state.path];
      point.point_mm = state.point_mm;
      ++point.trials;
      if (touch.quality != Quality::kFresh) continue;
      const double error_mm = static_cast<double>((touch.point_mm - state.point_mm).norm());
      point.errors_mm.push_back(error_mm);
      MotionBand& band = bands[band_of(static_cast<double>(touch.plate_motion_mm))];
      ++band.touches;
      for (int k = 0; k < kRadii; ++k) {
        band.inside[static_cast<std::size_t>(k)] += error_mm <= 0.1 * (k + 1) * static_cast<double>(touch.radius_68_mm);
      }
    }
  }
  json face = json::array(), reliability = json::array();
  for (const auto& [path, point] : points) {
    const double touches = static_cast<double>(point.errors_mm.size());
    double sum_mm = 0;
    for (const double error_mm : point.errors_mm) sum_mm += error_mm;
    face.push_back({{"x_mm", point.point_mm.x()},
                    {"y_mm", point.point_mm.y()},
                    {"touches", point.errors_mm.size()},
                    {"published", touches / point.trials},
                    {"mean_mm", touches > 0 ? json(sum_mm / touches) : json()},
                    {"error_95_mm", touches > 0 ? json(quantile(point.errors_mm, 0.95)) : json()}});
  }
  for (const auto& [from_mm, band] : bands) {
    json inside = json::array();
    for (const int count : band.inside) inside.push_back(static_cast<double>(count) / band.touches);
    reliability.push_back({{"from_mm", from_mm}, {"touches", band.touches}, {"inside", inside}});
  }
  return {{"face", face}, {"reliability", reliability}};
}

}  // namespace finsight::host
