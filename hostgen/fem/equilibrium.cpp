// Letters: r residual (load minus internal forces), K tangent, d = K^-1 r the step, "chord" a step with an older K.
#include "hostgen/fem/equilibrium.h"

#include <algorithm>
#include <cmath>

namespace finsight::host {
namespace {

constexpr double kTolerance = 1e-8;  // of the load's norm
constexpr int kMaxFactorisations = 12, kMaxSteps = 40;
// Volume ratio at a Gauss point below which an element is as good as inverted.
constexpr double kSmallestJ = 0.05;
// A new factor takes as long as this many chord steps. Measured on the default finger: 35 against 7 ms.
constexpr double kChordsPerFactor = 5;

double norm(std::span<const double> a) {
  double total = 0;
  for (const double x : a) total += x * x;
  return std::sqrt(total);
}

}  // namespace

Equilibrium::Equilibrium(const ElasticBody& body)
    : body_(body),
      cholesky_(body.plan().view()),
      residual_(body.vector_size()),
      step_(body.vector_size()),
      rounded_(body.solved_size()) {}

double Equilibrium::residual_at(std::span<const double> load, const ElasticState& state) {
  smallest_J_ = body_.forces(state.u, residual_);
  for (std::size_t i = 0; i < residual_.size(); ++i) residual_[i] = load[i] - residual_[i];
  std::fill_n(residual_.end() - 3, 3, 0.0);
  return norm(residual_);
}

// Solves for the step; returns its size in the norm of energy, in which chords shrink evenly.
double Equilibrium::find_correction() {
  std::copy_n(residual_.begin(), rounded_.size(), rounded_.begin());
  cholesky_.solve(rounded_);
  double energy = 0;
  for (std::size_t i = 0; i < rounded_.size(); ++i) energy += residual_[i] * static_cast<double>(rounded_[i]);
  return std::sqrt(std::abs(energy));
}

void Equilibrium::take_step(ElasticState& state) {
  std::copy(rounded_.begin(), rounded_.end(), step_.begin());
  for (std::size_t i = 0; i < step_.size(); ++i) state.u[i] += step_[i];
  ++cost_.steps;
}

// A new K takes the stresses at the displacements before the last step, changed by it to first order: Newton then needs
// fewer steps than with those after it, because rotations of slender walls do not look like strains (Magisano, Leonetti
// and Garcea 2017, "mixed integration points").
bool Equilibrium::factorise(ElasticState& state) {
  if (cost_.steps > first_step_) {
    for (std::size_t i = 0; i < step_.size(); ++i) state.u[i] -= step_[i];
    body_.stresses(state.u, step_, state.stress);
    for (std::size_t i = 0; i < step_.size(); ++i) state.u[i] += step_[i];
  }
  body_.tangent(state.u, state.stress, cholesky_.values());
  ++cost_.factorisations;
  return cholesky_.factor();
}

// K is factored in single precision: it only steers the steps, whose residuals are in double, so the answer loses
// nothing. Every solve starts with its own K, so that it does not depend on the one before. Chords follow as long as
// they shrink so fast that going on takes less time than a new factor. They only converge where the tangent is positive
// definite as K is, so what they find is stable.
bool Equilibrium::solve(std::span<const double> load, ElasticState& state) {
  const double goal = kTolerance * norm(load) + 1e-14;
  const long last_factorisation = cost_.factorisations + kMaxFactorisations, last_step = cost_.steps + kMaxSteps;
  first_step_ = cost_.steps;
  double last_size = 0;
  long chords = 0;  // with the present factor
  while (true) {
    const double residual = residual_at(load, state);
    if (!(smallest_J_ > kSmallestJ) || !std::isfinite(residual)) return false;
    if (residual <= goal) break;
    if (cost_.steps == last_step) return false;
    bool refactor = cost_.steps == first_step_;
    if (!refactor) {
      const double size = find_correction();
      // The first step after a new factor shrinks more than those that follow.
      const double rate = size / last_size * (chords == 1 ? 1.5 : 1);
      refactor = !(rate < 1) || std::log(residual / goal) > -std::log(rate) * kChordsPerFactor;
      last_size = size;
    }
    if (refactor) {
      if (cost_.factorisations == last_factorisation || !factorise(state)) return false;
      last_size = find_correction();
      chords = 0;
    }
    take_step(state);
    ++chords;
  }
  std::fill(step_.begin(), step_.end(), 0.0);
  body_.stresses(state.u, step_, state.stress);
  return true;
}

bool Equilibrium::linearise(const ElasticState& state) {
  body_.tangent(state.u, state.stress, cholesky_.values());
  ++cost_.factorisations;
  return cholesky_.factor();
}

void Equilibrium::apply_inverse(std::span<double> b) {
  std::copy_n(b.begin(), rounded_.size(), rounded_.begin());
  cholesky_.solve(rounded_);
  std::copy(rounded_.begin(), rounded_.end(), b.begin());
  std::fill_n(b.end() - 3, 3, 0.0);
}

void Equilibrium::apply_inverse(Columns& columns) {
  constexpr Eigen::Index kLanes = simd::kLanesOf<float>;
  std::vector<simd::Vector<float>> b(rounded_.size());
  for (Eigen::Index first = 0; first < columns.cols(); first += kLanes) {
    const Eigen::Index count = std::min(kLanes, columns.cols() - first);
    for (std::size_t i = 0; i < b.size(); ++i) {
      for (Eigen::Index k = 0; k < count; ++k) {
        b[i][k] = static_cast<float>(columns(static_cast<Eigen::Index>(i), first + k));
      }
    }
    cholesky_.solve(b);
    for (std::size_t i = 0; i < b.size(); ++i) {
      for (Eigen::Index k = 0; k < count; ++k) columns(static_cast<Eigen::Index>(i), first + k) = b[i][k];
    }
  }
  columns.bottomRows<3>().setZero();
}

}  // namespace finsight::host
