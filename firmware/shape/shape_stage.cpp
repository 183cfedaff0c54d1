#include "firmware/shape/shape_stage.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "firmware/shape/newton.h"
#include "firmware/shape/shape_map.h"

namespace finsight {

struct ShapeStage::Workspace {
  Workspace(const ShapeModel& model, const ShapeMapModel& map_model, const MountModel& mount,
            const ShapeSettings& stage_settings)
      : settings(stage_settings),
        rest_mm(model.rest_mm),
        front_nodes(model.front_nodes),
        map(map_model, model),
        plates(model, mount),
        map_mm(rest_mm.begin(), rest_mm.end()) {
    if (settings.tier != ShapeSettings::Tier::kMap) newton.emplace(model, mount);
    shape.node_mm = map_mm;
  }

  void run_map(const PlatePoses& poses) {
    map.evaluate(plate_numbers(poses), map_mm);
    plates.place<float>(plate_motions(poses), map_mm);
  }
  void answer_by_map(const PlatePoses& poses);
  void answer_by_newton(const PlatePoses& poses);
  void measure();

  ShapeSettings settings;
  std::span<const float> rest_mm;
  std::span<const std::int32_t> front_nodes;
  ShapeMap map;
  RigidPlates plates;
  std::optional<NewtonSolver<float>> newton;
  std::vector<float> map_mm;
  bool has_last = false;  // the solver holds the last frame's shape
  FingerShape shape;
};

ShapeStage::ShapeStage(const ShapeModel& shape, const ShapeMapModel& map, const MountModel& mount,
                       const ShapeSettings& settings)
    : work_(std::make_unique<Workspace>(shape, map, mount, settings)) {}

ShapeStage::~ShapeStage() = default;

void ShapeStage::reset() { work_->has_last = false; }

const FingerShape& ShapeStage::solve(const PlatePoses& poses) {
  FingerShape& shape = work_->shape;
  shape.iterations = 0;
  shape.fallback = false;
  if (poses.quality == Quality::kInvalid) {
    shape.quality = Quality::kInvalid;
    work_->has_last = false;
    return shape;
  }
  if (!work_->plates.plausible(poses)) {
    shape.fallback = true;
  } else if (work_->newton) {
    work_->answer_by_newton(poses);
  } else {
    work_->answer_by_map(poses);
  }
  const bool measured = poses.quality == Quality::kFresh && poses.seen_count() == kPlates && !shape.fallback;
  shape.quality = shape.source == ShapeSource::kRest ? Quality::kInvalid : measured ? Quality::kFresh : Quality::kHeld;
  work_->measure();
  return shape;
}

void ShapeStage::Workspace::answer_by_map(const PlatePoses& poses) {
  run_map(poses);
  shape.source = ShapeSource::kMap;
}

// The map's shape is where the solver starts when it has no last shape, and where it goes when it fails. A map's shape
// with an inverted element is not taken over; the solver then stays with what it has.
void ShapeStage::Workspace::answer_by_newton(const PlatePoses& poses) {
  const bool start = !has_last || settings.tier == ShapeSettings::Tier::kMapAndNewton;
  if (start) {
    run_map(poses);
    newton->start_from(map_mm, poses);
  }
  const auto outcome = newton->solve(poses, settings.factorisations, settings.chord_steps);
  shape.iterations = outcome.steps;
  has_last = outcome.ok;
  if (outcome.ok) {
    shape.source = ShapeSource::kNewton;
  } else {
    shape.fallback = true;
    if (!start) run_map(poses);
    if (newton->start_from(map_mm, poses)) shape.source = ShapeSource::kMap;
  }
  shape.node_mm = newton->node_mm();
}

void ShapeStage::Workspace::measure() {
  const auto squared_mm2 = [&](std::size_t node) {
    double sum = 0;
    for (std::size_t i = 3 * node; i < 3 * node + 3; ++i) {
      const double u = static_cast<double>(shape.node_mm[i]) - static_cast<double>(rest_mm[i]);
      sum += u * u;
    }
    return sum;
  };
  double all = 0, front = 0, largest = 0;
  const std::size_t nodes = rest_mm.size() / 3;
  for (std::size_t node = 0; node < nodes; ++node) {
    const double u_sq = squared_mm2(node);
    all += u_sq;
    largest = std::max(largest, u_sq);
  }
  for (const std::int32_t node : front_nodes) front += squared_mm2(node);
  const auto front_count = static_cast<double>(std::max<std::size_t>(front_nodes.size(), 1));
  shape.rms_mm = static_cast<float>(std::sqrt(all / static_cast<double>(nodes)));
  shape.front_rms_mm = static_cast<float>(std::sqrt(front / front_count));
  shape.largest_mm = static_cast<float>(std::sqrt(largest));
}

}  // namespace finsight
