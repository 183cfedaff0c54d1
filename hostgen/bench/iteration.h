// One Newton iteration of the shape by several methods, so that their times can be compared in one run on one core.
#pragma once

#include <functional>
#include <span>

#include "firmware/model/model.h"

namespace finsight::host {

struct IterationTime {
  double derivatives_us = 0;  ///< gradient and projected Hessian, in the form that the factorisation takes
  double factor_us = 0;
  double solve_us = 0;
  double step_us = 0;  ///< what bounds the step: the inversion bound of ours, the first energy of a line search
  double sum_us() const { return derivatives_us + factor_us + solve_us + step_us; }
};

/// Repeats the iteration at one shape; throws std::runtime_error if a factorisation fails there.
using Iteration = std::function<IterationTime()>;

/// What the frame loop does. S: float or double. node_mm: [3 * nodes] without inverted tetrahedra.
template <class S>
Iteration our_iteration(const ShapeModel& model, std::span<const double> node_mm);
/// Our derivatives, Eigen's SimplicialLDLT on a pattern that it has analysed before.
Iteration eigen_iteration(const ShapeModel& model, std::span<const double> node_mm);
/// Our derivatives, CHOLMOD's supernodal factorisation on a pattern that it has analysed before.
Iteration cholmod_iteration(const ShapeModel& model, std::span<const double> node_mm);
/// The published method (paper, section 2.2): plates on springs, every tetrahedron's derivatives by automatic
/// differentiation and its Hessian projected by a dense eigen-solver, the matrix assembled from triplets, analysed
/// and factored by SimplicialLDLT every time. `soft`: of make_soft_shape_model().
Iteration published_iteration(const ShapeModel& soft, std::span<const double> node_mm);

}  // namespace finsight::host
