// Letters: r residual (load minus internal forces), K tangent, d = K^-1 r the step, "chord" a step with an older K.
#include "hostgen/fem/equilibrium.h"

#include <algorithm>
#include <cmath>

#include "hostgen/util/common.h"
#include "hostgen/util/random.h"

namespace finsight::host {
namespace {

constexpr double kTolerance = 1e-8;  // of the load's norm
constexpr int kMaxFactorisations = 12, kMaxSteps = 40;
// Volume ratio at a tet's point below which an element is as good as inverted.
constexpr double kSmallestJ = 0.05;
// A new factor takes as long as this many chord steps. Measured on the default finger: 35 against 7 ms.
constexpr double kChordsPerFactor = 5;

// In double precision, steps that no longer shrink and are shorter than this share of the displacements come from the
// rounding of internal forces: stiff parts of a slender body carry forces far beyond the load.
constexpr double kRounding = 1e-6;

double largest(std::span<const double> a) {
  double most = 0;
  for (const double x : a) most = std::max(most, std::abs(x));
  return most;
}

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
      correction_(body.vector_size()),
      step_(body.vector_size()),
      rounded_(body.solved_size()) {
  cholesky_.give_up_when(interrupt_flag());
}

double Equilibrium::residual_at(std::span<const double> load, const ElasticState& state) {
  smallest_J_ = body_.forces(state.u, residual_);
  for (std::size_t i = 0; i < residual_.size(); ++i) residual_[i] = load[i] - residual_[i];
  std::fill_n(residual_.end() - 3, 3, 0.0);
  return norm(residual_);
}

// Solves for the correction; returns its size in the norm of energy, in which chords shrink evenly.
double Equilibrium::find_correction() {
  std::copy(residual_.begin(), residual_.end(), correction_.begin());
  apply_inverse(correction_);
  double energy = 0;
  for (std::size_t i = 0; i < correction_.size(); ++i) energy += residual_[i] * correction_[i];
  return std::sqrt(std::abs(energy));
}

void Equilibrium::take_step(ElasticState& state) {
  std::copy(correction_.begin(), correction_.end(), step_.begin());
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
  return factor_tangent(state);
}

// In double precision once single has failed in this solve: slender bodies with stiff parts have condition numbers
// beyond what its 24 bits can tell from a body that gives way.
bool Equilibrium::factor_tangent(const ElasticState& state) {
  ++cost_.factorisations;
  if (!in_double_) {
    body_.tangent(state.u, state.stress, cholesky_.values());
    if (cholesky_.factor()) return true;
    if (interrupted()) throw Interrupted();
    in_double_ = true;
  }
  if (!double_cholesky_) {
    double_cholesky_ = std::make_unique<Cholesky<double>>(body_.plan().view());
    double_cholesky_->give_up_when(interrupt_flag());
  }
  body_.tangent(state.u, state.stress, double_cholesky_->values());
  ++cost_.in_double;
  const bool positive = double_cholesky_->factor();
  if (interrupted()) throw Interrupted();
  return positive;
}

/// Whether the factor in single precision, where the solve started, solves its own equation to a few per cent.
bool Equilibrium::single_serves(std::span<const double> load, ElasticState& state) {
  constexpr double kGood = 0.03;
  if (!(residual_at(load, state) > 0)) return true;
  first_step_ = cost_.steps;
  if (!factorise(state) || in_double_) return false;
  find_correction();
  std::vector<double> product(residual_.size());
  body_.times_tangent(state.u, state.stress, correction_, product);
  for (std::size_t i = 0; i < product.size(); ++i) product[i] -= residual_[i];
  std::fill_n(product.end() - 3, 3, 0.0);
  return norm(product) < kGood * norm(residual_);
}

// What single precision spoils is tried again in double: where its factor is bad, steps lead nowhere or astray.
bool Equilibrium::solve(std::span<const double> load, ElasticState& state) {
  const ElasticState start = state;
  in_double_ = false;
  if (descend(load, state)) return true;
  if (in_double_) return false;
  state = start;
  if (single_serves(load, state)) return false;
  in_double_ = true;
  state = start;
  return descend(load, state);
}

// K is factored in single precision: it only steers the steps, whose residuals are in double, so the answer loses
// nothing. Every solve starts with its own K, so that it does not depend on the one before. Chords follow as long as
// they shrink so fast that going on takes less time than a new factor. They only converge where the tangent is positive
// definite as K is, so what they find is stable.
bool Equilibrium::descend(std::span<const double> load, ElasticState& state) {
  const double goal = kTolerance * norm(load) + 1e-14;
  const long last_factorisation = cost_.factorisations + kMaxFactorisations, last_step = cost_.steps + kMaxSteps;
  first_step_ = cost_.steps;
  double last_size = 0;
  long chords = 0;  // with the present factor
  while (true) {
    if (interrupted()) throw Interrupted();
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
      if (refactor && in_double_ && largest(correction_) < kRounding * largest(state.u)) break;
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

bool Equilibrium::linearise(const ElasticState& state, Precision precision) {
  in_double_ = precision == Precision::kDouble;
  return factor_tangent(state);
}

// Inverse iteration. Where a body is about to give way, its softest motion stands far from the next, and the first few
// iterations find it.
double Equilibrium::softest_stiffness(const ElasticState& state) {
  constexpr int kIterations = 10;
  if (!linearise(state, Precision::kDouble)) return 0;
  Random random(0);
  std::vector<double> motion(residual_.size());
  for (double& x : motion) x = random.uniform(-1, 1);
  std::fill_n(motion.end() - 3, 3, 0.0);
  double compliance = 0;
  for (int k = 0; k < kIterations; ++k) {
    const double length = norm(motion);
    for (double& x : motion) x /= length;
    std::vector<double> response = motion;
    apply_inverse(response);
    compliance = 0;
    for (std::size_t i = 0; i < motion.size(); ++i) compliance += motion[i] * response[i];
    motion = std::move(response);
  }
  return 1 / compliance;
}

void Equilibrium::apply_inverse(std::span<double> b) {
  if (in_double_) {
    double_cholesky_->solve(b.first(rounded_.size()));
  } else {
    std::copy_n(b.begin(), rounded_.size(), rounded_.begin());
    cholesky_.solve(rounded_);
    std::copy(rounded_.begin(), rounded_.end(), b.begin());
  }
  std::fill_n(b.end() - 3, 3, 0.0);
}

namespace {

/// As many columns at once as fit into a vector.
template <class S>
void solve_columns(const Cholesky<S>& cholesky, std::size_t size, Equilibrium::Columns& columns) {
  constexpr Eigen::Index kLanes = simd::kLanesOf<S>;
  std::vector<simd::Vector<S>> b(size);
  for (Eigen::Index first = 0; first < columns.cols(); first += kLanes) {
    const Eigen::Index count = std::min(kLanes, columns.cols() - first);
    for (std::size_t i = 0; i < b.size(); ++i) {
      for (Eigen::Index k = 0; k < count; ++k) {
        b[i][k] = static_cast<S>(columns(static_cast<Eigen::Index>(i), first + k));
      }
    }
    cholesky.solve(b);
    for (std::size_t i = 0; i < b.size(); ++i) {
      for (Eigen::Index k = 0; k < count; ++k) columns(static_cast<Eigen::Index>(i), first + k) = b[i][k];
    }
  }
  columns.bottomRows<3>().setZero();
}

}  // namespace

void Equilibrium::apply_inverse(Columns& columns) {
  if (in_double_) {
    solve_columns(*double_cholesky_, rounded_.size(), columns);
  } else {
    solve_columns(cholesky_, rounded_.size(), columns);
  }
}

}  // namespace finsight::host
