#include "hostgen/report/scene_shapes.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "firmware/shape/shape_stage.h"
#include "firmware/touch/touch_stage.h"
#include "hostgen/learn/touch_samples.h"
#include "hostgen/util/random.h"
#include "hostgen/util/statistics.h"
#include "hostgen/util/stopwatch.h"

namespace finsight::host {

using nlohmann::json;

namespace {

struct Errors {
  std::vector<double> signed_errors, sizes;
  void add(double error) {
    signed_errors.push_back(error);
    sizes.push_back(std::abs(error));
  }
  double bias() const {
    double sum = 0;
    for (const double error : signed_errors) sum += error;
    return sum / static_cast<double>(signed_errors.size());
  }
};

}  // namespace

json compare_shapes(const Model& model, const FingerSpec& spec, const std::vector<CaseState>& states) {
  json tiers = json::array();
  for (const auto& [name, tier] : kShapeTiers) {
    if (states.empty() || (tier == ShapeSettings::Tier::kContact && !model.contact_map)) continue;
    ShapeStage stage(model, {.tier = tier});
    TouchStage touch(model);
    Random random(98);
    Errors level, largest_mm;
    std::vector<double> us;
    for (const CaseState& solved : states) {
      PoseVector numbers = pose_vector({.plates = solved.state.plates, .seen = {true, true, true}});
      add_noise(spec.noise, random, numbers);
      stage.reset();
      Stopwatch watch;
      const PlatePoses poses = seen_poses({numbers.data(), kPoseDims});
      const bool is_explained = !touch.locate(poses, numbers, {.is_from_rest = true}).unexplained;
      watch.lap_us();
      const FingerShape& shape = stage.solve(poses, numbers, is_explained);
      us.push_back(watch.lap_us());
      const double front_mm = static_cast<double>(solved.shape.front_rms_mm);
      level.add((static_cast<double>(shape.front_rms_mm) - front_mm) / front_mm);
      largest_mm.add(static_cast<double>(shape.largest_mm - solved.shape.largest_mm));
    }
    tiers.push_back({{"tier", name},
                     {"level_bias", level.bias()},
                     {"level_95", quantile(level.sizes, 0.95)},
                     {"largest_bias_mm", largest_mm.bias()},
                     {"largest_95_mm", quantile(largest_mm.sizes, 0.95)},
                     {"us", quantile(us, 0.5)}});
  }
  return tiers;
}

}  // namespace finsight::host
