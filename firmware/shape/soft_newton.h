// The published way to the shape: the plates are not moved but pulled by stiff springs, and every solve iterates until
// it has converged. Kept as the reference and the baseline of measurements; the frame loop uses NewtonSolver.
#pragma once

#include <span>
#include <vector>

#include "firmware/shape/elements.h"
#include "firmware/shape/rigid_plates.h"

namespace finsight {

/// Minimises E(x) + omega sum |x_c - target_c|^2 over all nodes but the base's; c are the nodes of the plates. Newton
/// steps with the projected Hessian and a line search (the paper's Algorithm 1). S is float or double. Nothing
/// allocates or throws after the constructor.
template <class S>
class SoftNewtonSolver {
 public:
  static constexpr double kPublishedOmega = 1e5, kPublishedEpsilon = 1e-4;
  static constexpr int kPublishedSteps = 1000;

  /// The finger at rest. The nodes of the plates must be free in `model`. Throws InputError if they are not, or if the
  /// model is inconsistent.
  SoftNewtonSolver(const ShapeModel& model, const MountModel& mount, double omega = kPublishedOmega);

  struct Outcome {
    bool ok = false;  ///< converged
    int steps = 0;    ///< factorisations
  };
  /// Steps until the Newton decrement, half of what a full step would gain, is below `epsilon`. Not ok if the poses are
  /// not plausible or a pivot fails, if no step along the last direction lowers the energy, or after `max_steps`. The
  /// shape has no inverted tetrahedron in any case.
  Outcome converge(const PlatePoses& poses, double epsilon = kPublishedEpsilon, int max_steps = kPublishedSteps);

  void start_at_rest() { x_ = rest_; }
  std::span<const S> node_mm() const { return x_; }

 private:
  double energy(std::span<const S> x) const;
  double newton_step();
  bool search_line(double slope);

  Cholesky<S> cholesky_;
  Elements<S> elements_;
  RigidPlates rigid_plates_;
  double omega_;
  // A node of a plate: 3 * node, and where its block on the diagonal begins among Cholesky::values().
  struct Handle {
    std::int32_t offset;
    std::size_t block;
  };
  std::vector<Handle> handles_;
  std::vector<std::int32_t> free_offsets_;
  std::vector<S> rest_, x_, trial_, step_, gradient_, solution_, target_;
};

extern template class SoftNewtonSolver<float>;
extern template class SoftNewtonSolver<double>;

}  // namespace finsight
