#include "firmware/shape/newton.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "firmware/shape/flush_denormals.h"
#include "firmware/shape/free_step.h"

// Legend: x positions, g gradient, H Hessian, index f free nodes, c nodes of the plates (they are moved, not solved
// for).

namespace finsight {

namespace {

// How far a step may carry a plate, in mean edge lengths: the linearisation that moves the free nodes along with the
// plates is good for about this much.
constexpr double kPlateStepEdges = 0.6;

}  // namespace

template <class S>
NewtonSolver<S>::NewtonSolver(const ShapeModel& model, const MountModel& mount)
    : NewtonFactor<S>(model), ShapeState<S>(model, mount, &cholesky_) {
  before_.resize(x_.size());
  gradient_.resize(x_.size());
  solution_.resize(3 * free_offsets_.size());
}

template <class S>
bool NewtonSolver<S>::is_jump(const PlateMotions& from, const PlateMotions& to) const {
  return rigid_plates_.furthest_mm(from, to) > kMaxFactorisations * plate_step_mm();
}

// Sets the plates' part of the next step: all the way, or as far as one step may carry them.
template <class S>
typename NewtonSolver<S>::Step NewtonSolver<S>::plan(const PlateMotions& target) {
  const double distance_mm = aim_at(target);
  Step step{.aim = target, .reaches_target = distance_mm <= plate_step_mm(), .moves_plates = distance_mm > 0};
  if (!step.reaches_target) {
    step.aim = between(plates_, target, 1 / std::ceil(distance_mm / plate_step_mm()));
    aim_at(step.aim);
  }
  return step;
}

// Returns how far the nodes of the plates have to go at most.
template <class S>
double NewtonSolver<S>::aim_at(const PlateMotions& plates) {
  double furthest_sq = 0;
  rigid_plates_.for_each_node(plates, [&](int node, const Eigen::Vector3d& position) {
    double distance_sq = 0;
    for (int d = 0; d < 3; ++d) {
      step_[3 * node + d] = static_cast<S>(position[d]) - x_[3 * node + d];
      distance_sq += static_cast<double>(step_[3 * node + d]) * static_cast<double>(step_[3 * node + d]);
    }
    furthest_sq = std::max(furthest_sq, distance_sq);
  });
  return std::sqrt(furthest_sq);
}

template <class S>
double NewtonSolver<S>::plate_step_mm() const {
  return kPlateStepEdges * elements_.mean_edge_mm();
}

template <class S>
typename NewtonSolver<S>::Outcome NewtonSolver<S>::solve(const PlatePoses& poses, int factorisations, int chord_steps) {
  return rigid_plates_.plausible(poses) ? solve(plate_motions(poses), factorisations, chord_steps) : Outcome{};
}

template <class S>
typename NewtonSolver<S>::Outcome NewtonSolver<S>::solve(const PlateMotions& target, int factorisations,
                                                         int chord_steps) {
  const FlushDenormals flush;
  Outcome outcome;
  before_ = x_;
  const PlateMotions start = plates_;
  for (int k = 1; k <= std::max(factorisations, kMaxFactorisations); ++k) {
    Step step = plan(target);
    if (!take(Kind::kNewton, step, outcome)) return go_back(outcome, start);
    outcome.ok = step.reaches_target && step.arrived;
    for (int chord = 0; chord < chord_steps && outcome.ok; ++chord) {
      if (!take(Kind::kChord, step, outcome)) return go_back(outcome, start);
    }
    if (outcome.ok && k >= factorisations && outcome.last_step_mm <= plate_step_mm() / 2) break;
  }
  return outcome;
}

template <class S>
typename NewtonSolver<S>::Outcome NewtonSolver<S>::converge(const PlatePoses& poses, double tolerance_mm,
                                                            int max_steps) {
  const FlushDenormals flush;
  Outcome outcome;
  if (!rigid_plates_.plausible(poses)) return outcome;
  before_ = x_;
  const PlateMotions start = plates_, target = plate_motions(poses);
  while (!outcome.ok && outcome.steps < max_steps) {
    Step step = plan(target);
    // While the plates move, the energy rises with their work: nothing to search then.
    const Kind kind = step.moves_plates ? Kind::kNewton : Kind::kSearched;
    if (!take(kind, step, outcome)) return go_back(outcome, start);
    outcome.ok = step.reaches_target && step.arrived && outcome.last_step_mm <= tolerance_mm;
  }
  return outcome;
}

// After a step that failed: the shape as it was before all of them.
template <class S>
typename NewtonSolver<S>::Outcome NewtonSolver<S>::go_back(Outcome outcome, const PlateMotions& plates) {
  x_ = before_;
  plates_ = plates;
  outcome.ok = false;
  return outcome;
}

// Newton: H_ff dx_f = -(g_f + H_fc dx_c), where dx_c takes the plates to their aim; the right-hand side already moves
// the free nodes along. (Moving the plates first and solving then inverts elements.) Chord: the same factor, new
// gradient, plates at rest. The step is cut where a tetrahedron would get close to flat; plates and free nodes go the
// same part of the way. False if a pivot fails or something is not finite.
template <class S>
bool NewtonSolver<S>::take(Kind kind, Step& step, Outcome& outcome) {
  ++outcome.steps;
  const bool new_factor = kind != Kind::kChord;
  if (new_factor) {
    elements_.gradient_and_hessian(x_, step_, gradient_, cholesky_.values());
  } else {
    rigid_plates_.for_each_node(step.aim, [&](int node, const Eigen::Vector3d&) {
      for (int d = 0; d < 3; ++d) step_[3 * node + d] = 0;
    });
    elements_.gradient(x_, gradient_);
  }
  const auto free = solve_free_step<S>(cholesky_, new_factor, free_offsets_, gradient_, solution_, step_);
  if (!free) return false;
  S length = elements_.longest_step(x_, step_);
  if (!(length > 0)) return false;
  if (kind == Kind::kSearched) length = search_line(length, free->slope);
  outcome.last_step_mm = length * free->largest;
  if (new_factor) step.arrived = length == 1 || !step.moves_plates;

  for (std::size_t i = 0; i < x_.size(); ++i) x_[i] += length * step_[i];
  plates_ = between(plates_, step.aim, static_cast<double>(length));
  if (step.arrived) {
    plates_ = step.aim;
    rigid_plates_.template place<S>(step.aim, x_);
  }
  return true;
}

// Armijo: halves the step until the energy falls by a part of what the slope promises, or by less than rounding shows.
template <class S>
S NewtonSolver<S>::search_line(S length, double slope) {
  constexpr int kMaxHalvings = 30;
  constexpr double kPartOfSlope = 1e-4;
  const double present = elements_.energy(x_);
  const double rounding = 8 * static_cast<double>(std::numeric_limits<S>::epsilon()) * present;
  for (int halving = 0; halving < kMaxHalvings; ++halving, length /= 2) {
    for (std::size_t i = 0; i < x_.size(); ++i) trial_[i] = x_[i] + length * step_[i];
    if (elements_.energy(trial_) <= present + kPartOfSlope * static_cast<double>(length) * slope + rounding) break;
  }
  return length;
}

template class NewtonSolver<float>;
template class NewtonSolver<double>;

}  // namespace finsight
