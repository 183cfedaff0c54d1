#include "hostgen/hard_cases/hard_case.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "hostgen/hard_cases/shape_distance.h"

namespace finsight::host {

namespace {

// Independent of the firmware's own check, and in double.
bool has_inverted(const ShapeModel& shape, std::span<const float> node_mm) {
  for (int t = 0; t < shape.tets; ++t) {
    const std::int32_t* tet = shape.tet_nodes.data() + 4 * t;
    Eigen::Matrix3d edges;
    for (int c = 0; c < 3; ++c)
      for (int d = 0; d < 3; ++d)
        edges(d, c) = static_cast<double>(node_mm[3 * tet[c + 1] + d]) - static_cast<double>(node_mm[3 * tet[0] + d]);
    if (!(edges.determinant() > 0)) return true;
  }
  return false;
}

bool is_finite(const FingerShape& shape) {
  const auto finite = [](float value) { return std::isfinite(value); };
  return std::all_of(shape.node_mm.begin(), shape.node_mm.end(), finite) && finite(shape.rms_mm) &&
         finite(shape.front_rms_mm) && finite(shape.largest_mm);
}

}  // namespace

HardCaseTruth::HardCaseTruth(const ShapeParts& parts, double unit_mm)
    : cold_(parts.shape, parts.mount), warm_(parts.shape, parts.mount), unit_mm_(unit_mm) {}

std::optional<double> HardCaseTruth::distance(const PlatePoses& poses, std::span<const float> node_mm) {
  constexpr double kTolerance = 1e-5;
  constexpr int kMaxSteps = 150;
  cold_.start_at_rest();
  const bool cold = cold_.converge(poses, kTolerance * unit_mm_, kMaxSteps).ok;
  const bool warm =
      warm_.start_from(node_mm, plate_motions(poses)) && warm_.converge(poses, kTolerance * unit_mm_, kMaxSteps).ok;
  if (!cold && !warm) return std::nullopt;
  const bool cold_is_better = cold && (!warm || cold_.energy() <= warm_.energy());
  return shape_distance(node_mm, (cold_is_better ? cold_ : warm_).node_mm()).worst_mm / unit_mm_;
}

void examine(const ShapeParts& parts, const FingerShape& shape, HardCaseResult& result) {
  ++result.frames;
  const bool flagged = shape.fallback || shape.quality == Quality::kInvalid;
  const bool inverted = has_inverted(parts.shape, shape.node_mm);
  result.flagged += flagged;
  result.non_finite += !is_finite(shape);
  result.inverted += inverted;
  result.inverted_unflagged += inverted && !flagged;
  result.max_steps = std::max(result.max_steps, shape.iterations);
  result.end_flagged = flagged;
}

// Every sixteenth frame is compared with the truth, and the last.
HardCaseResult run_hard_case(const ShapeParts& parts, const HardCase& hard_case) {
  HardCaseResult result{.name = hard_case.name};
  result.allowed_steps = max_steps(hard_case.settings);
  result.allowed_mm = hard_case.allowed_mm;
  result.allowed_end_mm = hard_case.allowed_end_mm;
  result.may_end_flagged = hard_case.may_end_flagged;
  ShapeStage stage(parts, hard_case.settings);
  HardCaseTruth truth(parts, hard_case.unit_mm);
  const std::vector<PlatePoses>& frames = hard_case.motion.frames;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    PlatePoses poses = frames[k];
    for (PlateMotion& plate : poses.plates) plate.displacement_mm *= static_cast<float>(hard_case.unit_mm);
    const FingerShape& shape = stage.solve(poses);
    examine(parts, shape, result);
    const bool is_last = k + 1 == frames.size();
    if (result.end_flagged || (k % 16 != 0 && !is_last)) continue;
    const std::optional<double> distance = truth.distance(poses, shape.node_mm);
    if (!distance) continue;
    if (*distance > result.worst_mm || result.worst_node_mm.empty()) {
      result.worst_mm = *distance;
      result.worst_node_mm.assign(shape.node_mm.begin(), shape.node_mm.end());
    }
    if (is_last) result.end_mm = *distance;
  }
  return result;
}

}  // namespace finsight::host
