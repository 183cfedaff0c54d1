#include "firmware/shape/newton.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "firmware/shape/flush_denormals.h"

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
  for (int i = 0; i < model.nodes; ++i)
    if (model.free_index[i] >= 0) free_offsets_[model.free_index[i]] = 3 * i;
  for (std::vector<S>* array : {&x_, &before_, &trial_, &step_, &gradient_}) array->resize(rest_.size());
  solution_.resize(3 * free_offsets_.size());
  start_at_rest();
}

template <class S>
void NewtonSolver<S>::start_at_rest() {
  x_ = rest_;
  plates_ = {};
}

template <class S>
bool NewtonSolver<S>::start_from(std::span<const float> node_mm, const PlatePoses& poses) {
  for (std::size_t i = 0; i < trial_.size(); ++i) trial_[i] = node_mm[i];
  if (!rigid_plates_.plausible(poses)) return false;
  const PlateMotions plates = plate_motions(poses);
  rigid_plates_.place<S>(plates, trial_);
  if (!(elements_.smallest_determinant(trial_) > 0)) return false;
  std::swap(x_, trial_);
  plates_ = plates;
  return true;
}

// Sets the plates' part of the next step and returns how far their nodes have to go.
template <class S>
double NewtonSolver<S>::aim(const PlateMotions& plates) {
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
int NewtonSolver<S>::parts_of(double distance_mm) const {
  const double parts = std::ceil(distance_mm / (kPlateStepEdges * elements_.mean_edge_mm()));
  return static_cast<int>(std::clamp(parts, 1.0, static_cast<double>(kMostFactorisations)));
}

template <class S>
typename NewtonSolver<S>::Outcome NewtonSolver<S>::solve(const PlatePoses& poses, int factorisations, int chord_steps) {
  const FlushDenormals flush;
  Outcome outcome;
  if (!rigid_plates_.plausible(poses)) return outcome;
  before_ = x_;
  const PlateMotions start = plates_, target = plate_motions(poses);
  const int parts = parts_of(aim(target));
  for (int k = 1; k <= std::max(factorisations, kMostFactorisations); ++k) {
    aim(k < parts ? between(start, target, static_cast<double>(k) / parts) : target);
    if (!take_step(true, false, outcome)) return fail(outcome, start);
    for (int chord = 0; chord < chord_steps && k >= parts; ++chord)
      if (!take_step(false, false, outcome)) return fail(outcome, start);
    outcome.ok = k >= parts && plates_at_aim_;
    if (outcome.ok && k >= factorisations) break;
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
    const double distance = aim(target);
    const int parts = parts_of(distance);
    if (parts > 1) aim(between(plates_, target, 1.0 / parts));
    // While the plates move, the energy rises with their work: nothing to search then.
    if (!take_step(true, distance == 0, outcome)) return fail(outcome, start);
    outcome.ok = parts == 1 && plates_at_aim_ && outcome.last_step_mm <= tolerance_mm;
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
    if (!cholesky_.factor()) return false;
  } else {
    rigid_plates_.for_each_node(aim_, [&](int node, const Eigen::Vector3d&) {
      for (int d = 0; d < 3; ++d) step_[3 * node + d] = 0;
    });
    elements_.gradient(x_, gradient_);
  }
  for (std::size_t i = 0; i < free_offsets_.size(); ++i)
    for (int d = 0; d < 3; ++d) solution_[3 * i + d] = -gradient_[free_offsets_[i] + d];
  cholesky_.solve(solution_);
  S largest = 0;
  double slope = 0;
  for (std::size_t i = 0; i < free_offsets_.size(); ++i)
    for (int d = 0; d < 3; ++d) {
      const S dx = solution_[3 * i + d];
      step_[free_offsets_[i] + d] = dx;
      largest = std::max(largest, std::abs(dx));
      slope += static_cast<double>(gradient_[free_offsets_[i] + d]) * static_cast<double>(dx);
    }
  S length = elements_.longest_step(x_, step_);
  if (!(length > 0)) return false;  // something is not finite
  if (search) length = search_line(length, slope);
  outcome.last_step_mm = length * largest;
  if (new_factor) plates_at_aim_ = length == 1;
  move(length);
  return true;
}

// Armijo: halves the step until the energy falls by a part of what the slope promises, or by less than rounding shows.
template <class S>
S NewtonSolver<S>::search_line(S length, double slope) {
  constexpr int kMostHalvings = 30;
  constexpr double kPartOfSlope = 1e-4;
  const double present = elements_.energy(x_);
  const double rounding = 8 * static_cast<double>(std::numeric_limits<S>::epsilon()) * present;
  for (int halving = 0; halving < kMostHalvings; ++halving, length /= 2) {
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
