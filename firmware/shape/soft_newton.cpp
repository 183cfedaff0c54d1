#include "firmware/shape/soft_newton.h"

#include <cmath>
#include <limits>
#include <string>

#include "firmware/input_error.h"
#include "firmware/shape/flush_denormals.h"
#include "firmware/shape/free_step.h"

// Legend: x positions, g gradient, H Hessian, omega the springs' stiffness, c nodes of the plates (the handles).

namespace finsight {

template <class S>
SoftNewtonSolver<S>::SoftNewtonSolver(const ShapeModel& model, const MountModel& mount, double omega)
    : cholesky_(model.cholesky), elements_(model, &cholesky_), rigid_plates_(model, mount), omega_(omega) {
  for (const float coordinate : model.rest_mm) rest_.push_back(coordinate);
  for (int i = 0; i < model.nodes; ++i) {
    const int unknown = model.free_index[i];
    if (model.node_kind[i] >= 2) {
      if (unknown < 0)
        throw InputError("shape model", "free_index", "node " + std::to_string(i) + " of a plate that is not free",
                         "plates that a soft solve can move");
      handles_.push_back({3 * i, 9 * cholesky_.place(unknown, unknown).index});
    }
    if (unknown < 0) continue;
    if (unknown != static_cast<int>(free_offsets_.size()))
      throw InputError("shape model", "free_index", std::to_string(unknown), std::to_string(free_offsets_.size()));
    free_offsets_.push_back(3 * i);
  }
  for (std::vector<S>* array : {&x_, &trial_, &step_, &gradient_, &target_}) array->resize(rest_.size());
  solution_.resize(3 * free_offsets_.size());
  start_at_rest();
}

template <class S>
typename SoftNewtonSolver<S>::Outcome SoftNewtonSolver<S>::converge(const PlatePoses& poses, double epsilon,
                                                                    int max_steps) {
  const FlushDenormals flush;
  Outcome outcome;
  if (!rigid_plates_.plausible(poses)) return outcome;
  rigid_plates_.place<S>(plate_motions(poses), target_);
  while (outcome.steps < max_steps) {
    ++outcome.steps;
    const double slope = newton_step();
    if (!std::isfinite(slope)) return outcome;
    outcome.ok = -slope / 2 < epsilon;
    if (outcome.ok || !search_line(slope)) return outcome;
  }
  return outcome;
}

template <class S>
double SoftNewtonSolver<S>::energy(std::span<const S> x) const {
  double springs = 0;
  for (const Handle& handle : handles_)
    for (int d = 0; d < 3; ++d) {
      const double gap = static_cast<double>(x[handle.offset + d]) - static_cast<double>(target_[handle.offset + d]);
      springs += gap * gap;
    }
  return elements_.energy(x) + omega_ * springs;
}

// Solves H step = -g and returns g^T step, the slope of the energy along the step; NaN if a pivot fails.
template <class S>
double SoftNewtonSolver<S>::newton_step() {
  elements_.gradient_and_hessian(x_, {}, gradient_, cholesky_.values());
  const S stiffness = static_cast<S>(2 * omega_);
  for (const Handle& handle : handles_)
    for (int d = 0; d < 3; ++d) {
      gradient_[handle.offset + d] += stiffness * (x_[handle.offset + d] - target_[handle.offset + d]);
      cholesky_.values()[handle.block + 4 * d] += stiffness;
    }
  const auto free = solve_free_step<S>(cholesky_, true, free_offsets_, gradient_, solution_, step_);
  return free ? free->slope : std::numeric_limits<double>::quiet_NaN();
}

// Shortens the step until the energy, which is infinite where a tetrahedron is inverted, falls by a part of what the
// slope promises. False, and x stays, if it never does.
template <class S>
bool SoftNewtonSolver<S>::search_line(double slope) {
  constexpr int kMaxTries = 64;
  constexpr double kShorten = 0.8, kPartOfSlope = 1e-4;
  const double present = energy(x_);
  double length = 1;
  for (int attempt = 0; attempt < kMaxTries; ++attempt, length *= kShorten) {
    for (std::size_t i = 0; i < x_.size(); ++i) trial_[i] = x_[i] + static_cast<S>(length) * step_[i];
    if (energy(trial_) <= present + kPartOfSlope * length * slope) {
      x_.swap(trial_);
      return true;
    }
  }
  return false;
}

template class SoftNewtonSolver<float>;
template class SoftNewtonSolver<double>;

}  // namespace finsight
