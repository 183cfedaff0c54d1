// Static equilibrium of an elastic body under dead loads: Newton's method whose factor is used again as long as that
// pays.
#pragma once

#include <span>
#include <vector>

#include "firmware/shape/cholesky.h"
#include "hostgen/fem/elastic_body.h"

namespace finsight::host {

/// A state of an ElasticBody, in its order: displacements of the nodes (mm) and stresses at the Gauss points (MPa).
struct ElasticState {
  std::vector<double> u, stress;
  explicit ElasticState(const ElasticBody& body) : u(body.vector_size()), stress(body.stress_size()) {}
};

/// Not thread-safe; bodies may be shared.
class Equilibrium {
 public:
  explicit Equilibrium(const ElasticBody& body);

  /// Finds the displacements whose internal forces balance `load` (N; a body vector) to 1e-8 of its norm. `state` is the
  /// start on entry (stresses may be a guess of their own, such as extrapolated ones) and the answer on success, with
  /// its own stresses. False if that start does not lead to an equilibrium at which the body resists every small motion
  /// (positive definite tangent); `state` then means nothing.
  bool solve(std::span<const double> load, ElasticState& state);
  /// Forgets the factor, so that the next answer does not depend on earlier ones, not even in its last digit.
  void reset() { factored_ = false; }

  /// What all solves took so far; for reports and tests.
  struct Cost {
    long factorisations = 0, steps = 0;
  };
  const Cost& cost() const { return cost_; }

 private:
  double residual_at(std::span<const double> load, const ElasticState& state);

  const ElasticBody& body_;
  Cholesky<double> cholesky_;
  std::vector<double> residual_, step_;
  double smallest_J_ = 1;
  bool factored_ = false;
  Cost cost_;
};

}  // namespace finsight::host
