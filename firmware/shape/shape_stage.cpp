#include "firmware/shape/shape_stage.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "firmware/input_error.h"
#include "firmware/shape/map_measures.h"
#include "firmware/shape/newton.h"
#include "firmware/shape/shape_map.h"

namespace finsight {

namespace {

// A shape is taken for a wrong minimum if the map's shape, which is not converged, costs less than this part of its
// elastic energy, by more than what rounding leaves of the energy at rest.
constexpr double kWrongMinimum = 0.9, kEnergyRounding = 1e-6;

// Elastic energy, as a part of the energy at rest, above which the plates are where no finger has them: strains of 40 %
// all over. (Bent by 40 mm and twisted by 90 degrees it is 0.02.)
constexpr double kMaxStrain = 0.1;

const ShapeMapModel& contact_map_of(const Model& model, ShapeSettings::Tier tier) {
  if (tier == ShapeSettings::Tier::kContact && !model.contact_map) {
    throw InputError(model.file().path(), "contact map", "none",
                     "one for tier \"contact\"; hostgen build puts it into the pack");
  }
  return model.contact_map;
}

}  // namespace

struct ShapeStage::Workspace {
  Workspace(const ShapeModel& model, const ShapeMapModel& map_model, const MountModel& mount,
            const ShapeSettings& stage_settings, const ShapeMapModel& contact_map_model)
      : settings(stage_settings),
        rest_mm(model.rest_mm),
        front_nodes(model.front_nodes),
        map(map_model, model),
        plates(model, mount),
        newton(model, mount),
        map_mm(rest_mm.begin(), rest_mm.end()),
        kept_mm(rest_mm.size()),
        rest_energy(newton.energy()) {
    shape.node_mm = newton.node_mm();
    if (settings.tier == ShapeSettings::Tier::kMeasures) map_measures.emplace(map_model, model);
    if (settings.tier == ShapeSettings::Tier::kContact) contact_map.emplace(contact_map_model, model);
  }

  void answer_by_measures(const PlatePoses& poses);
  bool answer_by_contact_map(const PlatePoses& poses);
  void take_map_shape(const ShapeMap& from, const PlatePoses& poses);
  void answer_by_map(const PlatePoses& poses);
  void answer_by_newton(const PlatePoses& poses);
  void try_from_rest(const PlatePoses& poses);
  bool solve(const PlatePoses& poses);
  bool wrong_minimum() const;
  bool strained() const { return newton.energy() - rest_energy > kMaxStrain * rest_energy; }
  void show(const ShapeMeasures& measures);

  ShapeSettings settings;
  std::span<const float> rest_mm;
  std::span<const std::int32_t> front_nodes;
  ShapeMap map;
  std::optional<MapMeasures> map_measures;  // tier kMeasures only
  std::optional<ShapeMap> contact_map;      // tier kContact only
  RigidPlates plates;
  NewtonSolver<float> newton;  // holds the published shape
  std::vector<float> map_mm;   // the map's shape of this frame
  std::vector<float> kept_mm;  // the present shape while another is tried
  double rest_energy;
  PlatePoses last_poses;
  bool was_rough = false;  // the last frame needed more than its schedule, failed or strained the finger too much
  bool has_last = false;   // the solver holds the last frame's shape, that of last_poses or on the way there
  FingerShape shape;
};

ShapeStage::ShapeStage(const Model& model, const ShapeSettings& settings)
    : ShapeStage(model.shape, model.shape_map, model.mount, settings, contact_map_of(model, settings.tier)) {}

ShapeStage::ShapeStage(const ShapeModel& shape, const ShapeMapModel& map, const MountModel& mount,
                       const ShapeSettings& settings, const ShapeMapModel& contact_map)
    : work_(std::make_unique<Workspace>(shape, map, mount, settings, contact_map)) {}

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
  } else if (work_->settings.tier == ShapeSettings::Tier::kMeasures) {
    work_->answer_by_measures(poses);
  } else {
    if (!work_->answer_by_contact_map(poses)) {
      work_->take_map_shape(work_->map, poses);
      if (work_->settings.tier <= ShapeSettings::Tier::kContact) {
        work_->answer_by_map(poses);
      } else {
        work_->answer_by_newton(poses);
      }
    }
    shape.node_mm = work_->newton.node_mm();
  }
  const bool measured = poses.quality == Quality::kFresh && !shape.fallback;
  shape.quality = shape.source == ShapeSource::kRest ? Quality::kInvalid : measured ? Quality::kFresh : Quality::kHeld;
  if (work_->settings.tier != ShapeSettings::Tier::kMeasures) {
    work_->show(measure_shape<float>(work_->rest_mm, work_->front_nodes, shape.node_mm));
  }
  return shape;
}

void ShapeStage::Workspace::answer_by_measures(const PlatePoses& poses) {
  shape.source = ShapeSource::kMap;
  shape.node_mm = {};
  show(map_measures->measure(map.coefficients(pose_vector(poses))));
}

void ShapeStage::Workspace::take_map_shape(const ShapeMap& from, const PlatePoses& poses) {
  from.evaluate(pose_vector(poses), map_mm);
  plates.place<float>(plate_motions(poses), map_mm);
}

bool ShapeStage::Workspace::answer_by_contact_map(const PlatePoses& poses) {
  if (!contact_map || !contact_map->covers(pose_vector(poses))) return false;
  take_map_shape(*contact_map, poses);
  if (!newton.start_from(map_mm, poses) || strained()) return false;
  shape.source = ShapeSource::kContactMap;
  return true;
}

// A shape with an inverted tetrahedron never goes out: the way from rest to it does, as far as it is possible.
void ShapeStage::Workspace::answer_by_map(const PlatePoses& poses) {
  shape.source = ShapeSource::kMap;
  const bool usable = newton.start_from(map_mm, poses);
  if (!usable) newton.start_towards(map_mm, poses);
  shape.fallback = !usable || strained();
}

// The map's shape is where the solver starts when it has no last shape or the plates have jumped, where it starts over
// when it got into a wrong minimum, and the answer when it fails. If the map's shape is none, the answer is how far the
// solver came, and the next frame goes on from there.
void ShapeStage::Workspace::answer_by_newton(const PlatePoses& poses) {
  const bool follow = has_last && settings.tier == ShapeSettings::Tier::kNewton && !newton.is_jump(last_poses, poses);
  if (!follow && !newton.start_from(map_mm, poses)) newton.start_towards(map_mm, poses);
  bool ok = solve(poses);
  const bool is_rough =
      follow && (!ok || shape.iterations > settings.factorisations * (1 + settings.chord_steps) || strained());
  if (follow && (!ok || wrong_minimum()) && newton.start_from(map_mm, poses)) {
    ok = solve(poses);
  } else if (follow && ok && was_rough) {
    try_from_rest(poses);
  }
  was_rough = is_rough;
  shape.source = ShapeSource::kNewton;
  shape.fallback = !ok || strained();
  has_last = true;
  last_poses = poses;
  if (!ok && newton.start_from(map_mm, poses)) {
    shape.source = ShapeSource::kMap;
    has_last = false;
  }
}

// What following the plates through a rough frame led to can be a wrong minimum that no shape of the map shows. What a
// solve from rest finds takes its place if that costs less energy.
void ShapeStage::Workspace::try_from_rest(const PlatePoses& poses) {
  const double energy = newton.energy();
  std::copy(newton.node_mm().begin(), newton.node_mm().end(), kept_mm.begin());
  newton.start_at_rest();
  if (!solve(poses) || !(newton.energy() < energy)) newton.start_from(kept_mm, poses);
}

// The step bound keeps determinants positive, but a tenth of a tenth of a tenth ends in rounding: an energy that is not
// finite tells.
bool ShapeStage::Workspace::solve(const PlatePoses& poses) {
  const auto outcome = newton.solve(poses, settings.factorisations, settings.chord_steps);
  shape.iterations += outcome.steps;
  if (std::isfinite(newton.energy())) return outcome.ok;
  newton.start_towards(map_mm, poses);
  return false;
}

bool ShapeStage::Workspace::wrong_minimum() const {
  return newton.energy_of(map_mm) <
         rest_energy + kWrongMinimum * (newton.energy() - rest_energy) - kEnergyRounding * rest_energy;
}

void ShapeStage::Workspace::show(const ShapeMeasures& measures) {
  shape.rms_mm = measures.rms_mm;
  shape.front_rms_mm = measures.front_rms_mm;
  shape.largest_mm = measures.largest_mm;
}

}  // namespace finsight
