// One hard case: a motion, what may come out of the shape stage for it, and the run that finds out what does.
#pragma once

#include <algorithm>
#include <optional>
#include <span>
#include <string>

#include "firmware/shape/newton.h"
#include "firmware/shape/shape_stage.h"
#include "hostgen/hard_cases/hard_cases.h"
#include "hostgen/hard_cases/hard_motions.h"

namespace finsight::host {

struct HardCase {
  std::string name;
  HardMotion motion;
  double allowed_mm = 0.1;       ///< while it moves
  double allowed_end_mm = 0.02;  ///< in the last frame; the motion stops some frames before
  bool may_end_flagged = false;  ///< the pose at the end is one that no shape without inverted elements has
  double unit_mm = 1;            ///< the motion is multiplied by it, the distances are divided: a finger in other units
  ShapeSettings settings{};
};

/// The largest number of steps that the stage may take for a frame.
constexpr int most_steps(const ShapeSettings& settings) {
  return 2 * std::max(settings.factorisations, NewtonSolver<float>::kMaxFactorisations) * (1 + settings.chord_steps);
}

/// Finds the shape that a frame should have come out with.
class HardCaseTruth {
 public:
  HardCaseTruth(const ShapeParts& parts, double unit_mm);

  /// Distance of a shape, in units, to the better of the minima found from rest and from the shape itself; nothing if
  /// neither is found.
  std::optional<double> distance(const PlatePoses& poses, std::span<const float> node_mm);

 private:
  NewtonSolver<double> cold_, warm_;
  double unit_mm_;
};

/// Counts a frame's shape into a result.
void examine(const ShapeParts& parts, const FingerShape& shape, HardCaseResult& result);

HardCaseResult run_hard_case(const ShapeParts& parts, const HardCase& hard_case);

/// Slivers, other units, other tiers and schedules, an inverted start, float against double, soft handles.
void run_variants(const ShapeParts& parts, std::vector<HardCaseResult>& results);

}  // namespace finsight::host
