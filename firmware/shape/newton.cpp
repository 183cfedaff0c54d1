#include "firmware/shape/newton.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "firmware/input_error.h"
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
    : cholesky_(model.cholesky), elements_(model, cholesky_), rigid_plates_(model, mount) {
  for (const float coordinate : model.rest_mm) rest_.push_back(coordinate);
  free_offsets_.resize(model.cholesky.blocks);
  int free_nodes = 0;
  for (int i = 0; i < model.nodes; ++i)
    if (model.free_index[i] >= 0) ++free_nodes;
  if (free_nodes != model.cholesky.blocks)
    throw InputError("shape model", "cholesky", std::to_string(model.cholesky.blocks) + " blocks",
                     std::to_string(free_nodes) + ", one for every free node");
  for (int i = 0; i < model.nodes; ++i)
    if (model.free_index[i] >= 0) free_offsets_.at(model.free_index[i]) = 3 * i;
  for (std::vector<S>* array : {&x_, &before_, &trial_, &step_, &gradient_}) array->resize(rest_.size());
  solution_.resize(3 * free_offsets_.size());
  start_at_rest();
}

template <class S>
void NewtonSolver<S>::start_at_rest() {
  x_ = rest_;
  plates_ = {};
}

// Of a given shape only the free nodes count: the base is at rest, and the plates are where their poses put them.
template <class S>
void NewtonSolver<S>::assemble_trial(std::span<const float> node_mm, const PlateMotions& plates) {
  trial_ = rest_;
  for (const std::int32_t offset : free_offsets_)
    for (int d = 0; d < 3; ++d) trial_[offset + d] = node_mm[offset + d];
  rigid_plates_.place<S>(plates, trial_);
}

template <class S>
bool NewtonSolver<S>::start_from(std::span<const float> node_mm, const PlatePoses& poses) {
  if (!rigid_plates_.plausible(poses)) return false;
  const PlateMotions plates = plate_motions(poses);
  assemble_trial(node_mm, plates);
  if (!(elements_.smallest_determinant(trial_) > 0)) return false;
  std::swap(x_, trial_);
  plates_ = plates;
  return true;
}

template <class S>
void NewtonSolver<S>::start_towards(std::span<const float> node_mm, const PlatePoses& poses) {
  start_at_rest();
  if (!rigid_plates_.plausible(poses)) return;
  const PlateMotions plates = plate_motions(poses);
  assemble_trial(node_mm, plates);
  for (std::size_t i = 0; i < x_.size(); ++i) step_[i] = trial_[i] - x_[i];
  const S part = elements_.longest_step(x_, step_);
  if (!(part > 0)) return;  // something is not finite
  for (std::size_t i = 0; i < x_.size(); ++i) x_[i] += part * step_[i];
  plates_ = between(plates_, plates, static_cast<double>(part));
}

template <class S>
bool NewtonSolver<S>::is_jump(const PlatePoses& from, const PlatePoses& to) const {
  return rigid_plates_.furthest_mm(plate_motions(from), plate_motions(to)) > kMaxFactorisations * plate_step_mm();
}

// Sets the plates' part of the next step: all the way, or as far as one step may carry them. Returns how far their
// nodes have to go in all.
template <class S>
double NewtonSolver<S>::aim(const PlateMotions& target) {
  const double distance_mm = aim_at(target);
  aim_is_target_ = distance_mm <= plate_step_mm();
  plates_move_ = distance_mm > 0;
  if (!aim_is_target_) aim_at(between(plates_, target, 1 / std::ceil(distance_mm / plate_step_mm())));
  return distance_mm;
}

template <class S>
double NewtonSolver<S>::aim_at(const PlateMotions& plates) {
  aim_ = plates;
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
  const FlushDenormals flush;
  Outcome outcome;
  if (!rigid_plates_.plausible(poses)) return outcome;
  before_ = x_;
  const PlateMotions start = plates_, target = plate_motions(poses);
  for (int k = 1; k <= std::max(factorisations, kMaxFactorisations); ++k) {
    aim(target);
    if (!take_step(true, false, outcome)) return fail(outcome, start);
    outcome.ok = aim_is_target_ && plates_at_aim_;
    for (int chord = 0; chord < chord_steps && outcome.ok; ++chord)
      if (!take_step(false, false, outcome)) return fail(outcome, start);
    if (outcome.ok && k >= factorisations && outcome.last_step_mm <= plate_step_mm() / 2) break;
  }
  return outcome;
}

template <class S>
typename NewtonSolver<S>::Outcome NewtonSolver<S>::converge(const PlatePoses& poses, double tolerance_mm,
                                                            int most_steps) {
  const FlushDenormals flush;
  Outcome outcome;
  if (!rigid_plates_.plausible(poses)) return outcome;
  before_ = x_;
  const PlateMotions start = plates_, target = plate_motions(poses);
  while (!outcome.ok && outcome.steps < most_steps) {
    // While the plates move, the energy rises with their work: nothing to search then.
    const bool search = aim(target) == 0;
    if (!take_step(true, search, outcome)) return fail(outcome, start);
    outcome.ok = aim_is_target_ && plates_at_aim_ && outcome.last_step_mm <= tolerance_mm;
  }
  return outcome;
}

template <class S>
typename NewtonSolver<S>::Outcome& NewtonSolver<S>::fail(Outcome& outcome, const PlateMotions& plates_before) {
  x_ = before_;
  plates_ = plates_before;
  outcome.ok = false;
  return outcome;
}

// Newton: H_ff dx_f = -(g_f + H_fc dx_c), where dx_c takes the plates to their aim; the right-hand side already moves
// the free nodes along. (Moving the plates first and solving then inverts elements.) Chord: the same factor, new
// gradient, plates at rest. The step is cut where a tetrahedron would get close to flat; plates and free nodes go the
// same part of the way.
template <class S>
bool NewtonSolver<S>::take_step(bool new_factor, bool search, Outcome& outcome) {
  ++outcome.steps;
  if (new_factor) {
    elements_.gradient_and_hessian(x_, step_, gradient_, cholesky_.values());
  } else {
    rigid_plates_.for_each_node(aim_, [&](int node, const Eigen::Vector3d&) {
      for (int d = 0; d < 3; ++d) step_[3 * node + d] = 0;
    });
    elements_.gradient(x_, gradient_);
  }
  const auto free = solve_free_step<S>(cholesky_, new_factor, free_offsets_, gradient_, solution_, step_);
  if (!free) return false;
  S length = elements_.longest_step(x_, step_);
  if (!(length > 0)) return false;  // something is not finite
  if (search) length = search_line(length, free->slope);
  outcome.last_step_mm = length * free->largest;
  if (new_factor) plates_at_aim_ = length == 1 || !plates_move_;
  move(length);
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

template <class S>
void NewtonSolver<S>::move(S length) {
  for (std::size_t i = 0; i < x_.size(); ++i) x_[i] += length * step_[i];
  plates_ = between(plates_, aim_, static_cast<double>(length));
  if (plates_at_aim_) {
    plates_ = aim_;
    rigid_plates_.place<S>(aim_, x_);
  }
}

template class NewtonSolver<float>;
template class NewtonSolver<double>;

}  // namespace finsight
