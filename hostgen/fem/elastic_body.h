// Internal forces and tangent stiffness of a neo-Hookean body of quadratic tetrahedra with fixed nodes.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "hostgen/fem/cholesky_plan.h"
#include "hostgen/fem/neo_hookean.h"
#include "hostgen/fem/quadratic_mesh.h"

namespace finsight::host {

/// Constant after construction: one body serves all threads. Every vector over its degrees of freedom is
/// [3 * (free nodes + 1)]: displacements or forces of the free nodes (unknown_of_node), then one place for all fixed
/// nodes, whose displacement must be zero and whose force means nothing.
class ElasticBody {
 public:
  /// `material`: one per tet. `check_in`: see plan_cholesky().
  ElasticBody(const QuadraticMesh& mesh, const std::vector<NeoHookean>& material, const CheckIn& check_in = {});
  ~ElasticBody();

  int free_nodes() const { return plan_.blocks; }
  std::size_t solved_size() const { return 3 * static_cast<std::size_t>(plan_.blocks); }
  std::size_t vector_size() const { return solved_size() + 3; }
  std::size_t stress_size() const;
  /// Per mesh node: its number among the free nodes; free_nodes() for fixed ones.
  const std::vector<int>& unknown_of_node() const { return unknown_of_node_; }
  const CholeskyPlanData& plan() const { return plan_; }

  /// Internal forces (N) at displacements `u` (mm): the gradient of the stored energy. Returns the smallest volume
  /// ratio det F of all points of the tets; unless it is positive, the forces mean nothing.
  double forces(std::span<const double> u, std::span<double> force) const;
  /// Stresses (second Piola-Kirchhoff, MPa) at `u`, changed to first order by the step `du`; stress_size() numbers in
  /// an order of the body's own.
  void stresses(std::span<const double> u, std::span<const double> du, std::span<double> stress) const;
  /// Derivative of the forces at `u` as blocks in the order of plan().pattern_row (N/mm), with the geometric part made
  /// by `stress`. It is the exact tangent if that is the stress at `u`, apart from the rounding of its sums.
  template <class Scalar>  // float or double
  void tangent(std::span<const double> u, std::span<const double> stress, std::span<Scalar> blocks) const;
  /// That derivative times the motion `w` (a body vector), with nothing rounded to single precision.
  void times_tangent(std::span<const double> u, std::span<const double> stress, std::span<const double> w,
                     std::span<double> product) const;

 private:
  struct Batch;
  std::vector<std::vector<int>> neighbours_of_free_nodes(const QuadraticMesh& mesh) const;

  std::vector<int> unknown_of_node_;
  CholeskyPlanData plan_;
  std::vector<Batch> batches_;
};

}  // namespace finsight::host
