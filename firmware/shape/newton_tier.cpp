#include "firmware/shape/newton_tier.h"

#include <algorithm>
#include <cmath>

namespace finsight {

namespace {

// A shape is taken for a wrong minimum if the map's shape, which is not converged, costs less than this part of its
// elastic energy, by more than what rounding leaves of the energy at rest.
constexpr double kWrongMinimum = 0.9, kEnergyRounding = 1e-6;

}  // namespace

NewtonTier::NewtonTier(const ShapeParts& parts, const ShapeSettings& settings)
    : follows_last_(settings.tier == ShapeSettings::Tier::kNewton),
      factorisations_(settings.factorisations),
      chord_steps_(settings.chord_steps),
      solver_(parts.shape, parts.mount),
      map_(parts.map, parts.shape),
      kept_mm_(parts.shape.rest_mm.size()) {}

void NewtonTier::solve(const PlateMotions& plates, const PoseVector& motion, bool, FingerShape& shape) {
  map_mm_ = map_.evaluate(plates, motion, solver_.rigid_plates());

  // Follow the plates from the last shape; without one, or after a jump, start from the map's.
  const bool follows = follows_last_ && last_plates_ && !solver_.is_jump(*last_plates_, plates);
  if (!follows && !solver_.start_from(map_mm_, plates)) solver_.start_towards(map_mm_, plates);
  bool solved = take_steps(plates, shape);
  const int scheduled = factorisations_ * (1 + chord_steps_);
  const bool is_rough = follows && (!solved || shape.iterations > scheduled || solver_.is_overstrained());

  // Start over where following led nowhere or into a wrong minimum.
  if (follows && (!solved || is_wrong_minimum()) && solver_.start_from(map_mm_, plates)) {
    solved = take_steps(plates, shape);
  } else if (follows && solved && was_rough_) {
    try_from_rest(plates, shape);
  }
  was_rough_ = is_rough;

  // Fall back to the map's shape. Where that is unusable too, the answer is how far the solver came, and the next frame
  // goes on from there.
  shape.source = ShapeSource::kNewton;
  shape.fallback = !solved || solver_.is_overstrained();
  last_plates_ = plates;
  if (!solved && solver_.start_from(map_mm_, plates)) {
    shape.source = ShapeSource::kMap;
    last_plates_.reset();
  }
}

// The step bound keeps determinants positive, but a tenth of a tenth of a tenth ends in rounding: an energy that is not
// finite tells.
bool NewtonTier::take_steps(const PlateMotions& plates, FingerShape& shape) {
  const auto outcome = solver_.solve(plates, factorisations_, chord_steps_);
  shape.iterations += outcome.steps;
  if (std::isfinite(solver_.energy())) return outcome.ok;
  solver_.start_towards(map_mm_, plates);
  return false;
}

// Following the plates through a rough frame can lead to a wrong minimum that the map's shape does not reveal. A solve
// from rest replaces it if the result has less energy.
void NewtonTier::try_from_rest(const PlateMotions& plates, FingerShape& shape) {
  const double energy = solver_.energy();
  std::copy(solver_.node_mm().begin(), solver_.node_mm().end(), kept_mm_.begin());
  solver_.start_at_rest();
  if (!take_steps(plates, shape) || !(solver_.energy() < energy)) solver_.start_from(kept_mm_, plates);
}

bool NewtonTier::is_wrong_minimum() const {
  const double rest = solver_.rest_energy();
  return solver_.energy_of(map_mm_) < rest + kWrongMinimum * (solver_.energy() - rest) - kEnergyRounding * rest;
}

}  // namespace finsight
