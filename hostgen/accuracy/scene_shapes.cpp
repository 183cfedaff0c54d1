#include "hostgen/accuracy/scene_shapes.h"

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

struct Differences {
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

/// A state as it is measured once.
struct Measured {
  const ShapeMeasures& truth;
  PlatePoses poses;
  PoseVector motion;
  bool is_explained;
};

std::vector<Measured> measure(const Model& model, const FingerSpec& spec, const std::vector<CaseState>& states) {
  TouchStage touch(model);
  Random random(98);
  std::vector<Measured> measured;
  for (const CaseState& solved : states) {
    PoseVector motion = pose_vector({.plates = solved.state.plates, .seen = {true, true, true}});
    add_noise(spec.noise, random, motion);
    const PlatePoses poses = seen_poses({motion.data(), kPoseDims});
    measured.push_back({solved.shape, poses, motion, !touch.locate(poses).unexplained});
  }
  return measured;
}

json judge(const char* tier, ShapeStage& stage, const std::vector<Measured>& states) {
  Differences level, largest_mm;
  std::vector<double> us;
  for (const Measured& state : states) {
    stage.reset();
    Stopwatch watch;
    const FingerShape& shape = stage.solve(state.poses, state.motion, state.is_explained);
    us.push_back(watch.lap_us());
    const double front_mm = static_cast<double>(state.truth.front_rms_mm);
    level.add((static_cast<double>(shape.front_rms_mm) - front_mm) / front_mm);
    largest_mm.add(static_cast<double>(shape.largest_mm - state.truth.largest_mm));
  }
  return {{"tier", tier},
          {"level_bias", level.bias()},
          {"level_95", quantile(level.sizes, 0.95)},
          {"largest_bias_mm", largest_mm.bias()},
          {"largest_95_mm", quantile(largest_mm.sizes, 0.95)},
          {"us", quantile(us, 0.5)}};
}

}  // namespace

json compare_shapes(const Model& model, const FingerSpec& spec, const std::vector<CaseState>& states) {
  using Tier = ShapeSettings::Tier;
  json tiers = json::array();
  if (states.empty()) return tiers;
  const std::vector<Measured> measured = measure(model, spec, states);
  for (const auto& [name, tier] : kShapeTiers) {
    if (tier == Tier::kBest || (tier == Tier::kContact && !model.contact_map)) continue;  // best is one of the others
    ShapeStage stage(model, {.tier = tier});
    tiers.push_back(judge(name, stage, measured));
  }
  return tiers;
}

}  // namespace finsight::host
