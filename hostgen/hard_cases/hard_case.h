// One hard case: a motion, the limits for the shape stage's answer, and the run that measures it.
#pragma once

#include <algorithm>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "firmware/shape/newton.h"
#include "firmware/shape/shape_stage.h"
#include "hostgen/hard_cases/hard_cases.h"
#include "hostgen/hard_cases/hard_motions.h"

namespace finsight::host {

/// HardCase::allowed_mm of a case that is judged by other limits.
constexpr double kNoLimit = std::numeric_limits<double>::infinity();

struct HardCase {
  std::string name;
  HardMotion motion;
  double allowed_mm = 0.1;       ///< error while it moves
  double allowed_end_mm = 0.02;  ///< error in the last frame; the motion stops some frames before
  bool may_end_flagged = false;  ///< the last pose is one that only shapes with inverted elements can have
  double unit_mm = 1;            ///< for a finger in other units: scales the motion, and distances back to mm
  ShapeSettings settings{};
};

/// The largest number of solver steps that the stage may take in a frame.
constexpr int max_steps(const ShapeSettings& settings) {
  return 2 * std::max(settings.factorisations, NewtonSolver<float>::kMaxFactorisations) * (1 + settings.chord_steps);
}

/// Finds the shape that the stage should have answered.
class HardCaseTruth {
 public:
  HardCaseTruth(const ShapeParts& parts, double unit_mm);

  /// Distance of a shape, in units of the case, to the lower of the minima found from rest and from the shape itself;
  /// nothing if neither solve converges.
  std::optional<double> distance(const PlatePoses& poses, std::span<const float> node_mm);

 private:
  NewtonSolver<double> cold_, warm_;
  double unit_mm_;
};

/// Adds a frame's shape to a result.
void examine(const ShapeParts& parts, const FingerShape& shape, HardCaseResult& result);

HardCaseResult run_hard_case(const ShapeParts& parts, const HardCase& hard_case);

/// A family of cases that are more than a motion.
struct HardVariant {
  const char* family;
  void (*run)(const ShapeParts&, std::vector<HardCaseResult>&);  ///< adds its results
};

/// Slivers, other units, other tiers and schedules, an inverted start, float against double, soft handles.
std::span<const HardVariant> hard_variants();

}  // namespace finsight::host
