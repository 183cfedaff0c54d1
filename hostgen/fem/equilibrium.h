// Static equilibrium of an elastic body under dead loads: Newton's method whose factor is used again as long as that
// pays.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>
#include <vector>

#include "firmware/shape/cholesky.h"
#include "hostgen/fem/elastic_body.h"

namespace finsight::host {

/// A state of an ElasticBody, in its order: displacements of the nodes (mm) and stresses at the tets' points (MPa).
struct ElasticState {
  std::vector<double> u, stress;
  explicit ElasticState(const ElasticBody& body) : u(body.vector_size()), stress(body.stress_size()) {}
};

struct EquilibriumCost {
  long factorisations = 0, steps = 0;
  long in_double = 0;  ///< of the factorisations
};

/// Not thread-safe; bodies may be shared.
class Equilibrium {
 public:
  explicit Equilibrium(const ElasticBody& body);

  /// Finds the displacements whose internal forces balance `load` (N; a body vector) to 1e-8 of its norm. `state` is
  /// the start on entry (stresses may be a guess of their own, such as extrapolated ones) and the answer on success,
  /// with its own stresses. False if that start does not lead to an equilibrium at which the body resists every small
  /// motion (positive definite tangent); `state` then means nothing. Tangents are factored in single precision, in
  /// double where that does not serve; there, less exactly where rounding allows no more. Throws Interrupted.
  bool solve(std::span<const double> load, ElasticState& state);
  enum class Precision { kSingle, kDouble };
  /// Factors the exact tangent at an equilibrium; false if it is not positive definite. solve() forgets it. In single
  /// precision the softest motions come out wrong by up to a tenth.
  bool linearise(const ElasticState& state, Precision precision = Precision::kSingle);
  /// How stiff the body is at an equilibrium against the motion that it resists least: the smallest eigenvalue of the
  /// tangent (N/mm; of the same mesh's states alone comparable), 0 if that is not positive definite. It falls towards 0
  /// where the body is about to buckle or to snap through. solve() forgets the factor, which is in double precision.
  double softest_stiffness(const ElasticState& state);
  /// That tangent's inverse times `b` (a body vector), in place, to the precision of its factor: first-order changes of
  /// displacements for changes of load, and, since it is symmetric, adjoints.
  void apply_inverse(std::span<double> b);
  /// The same for every column, in little more time than for one.
  using Columns = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  void apply_inverse(Columns& columns);
  /// The cost of all solves up to now.
  const EquilibriumCost& cost() const { return cost_; }

 private:
  double residual_at(std::span<const double> load, const ElasticState& state);
  double find_correction();
  void take_step(ElasticState& state);
  bool factorise(ElasticState& state);
  bool factor_tangent(const ElasticState& state);
  bool descend(std::span<const double> load, ElasticState& state);
  bool single_serves(std::span<const double> load, ElasticState& state);

  const ElasticBody& body_;
  Cholesky<float> cholesky_;
  std::unique_ptr<Cholesky<double>> double_cholesky_;  // made when first needed
  bool in_double_ = false;                             // the present factor is that one
  std::vector<double> residual_, correction_, step_;   // correction: K^-1 r; step: the last that was taken
  std::vector<float> rounded_;                         // the residual on its way to becoming the correction
  double smallest_J_ = 1;
  long first_step_ = 0;  // cost_.steps when the present solve began
  EquilibriumCost cost_;
};

}  // namespace finsight::host
