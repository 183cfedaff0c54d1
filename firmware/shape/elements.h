// All tetrahedra of the shape model in vectors: energy, forces, Hessian, and how long a step may be.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "firmware/shape/cholesky.h"
#include "firmware/shape/element.h"

namespace finsight {

/// S is float or double. Positions, steps and gradients are arrays of [3 * nodes]. Tetrahedra of the base or of
/// one plate alone are left out: they are rigid. Nothing allocates after the constructor.
template <class S>
class Elements {
 public:
  /// Without a Cholesky factorisation to assemble for, gradient_and_hessian() must not be called. Throws InputError for
  /// a tetrahedron that is inverted at rest.
  explicit Elements(const ShapeModel& model, const Cholesky<S>* cholesky = nullptr);

  /// Energy, the sum over tetrahedra (paper, section 2.2); infinite if one is inverted or not finite.
  double energy(std::span<const S> x) const;
  /// Its gradient.
  void gradient(std::span<const S> x, std::span<S> g) const;
  /// Gradient, and the positive semidefinite Hessian of the free nodes into `blocks` (Cholesky::values()). What a step
  /// of the plates' nodes changes in the forces on the free ones, H_fc * step, is added to the gradient.
  void gradient_and_hessian(std::span<const S> x, std::span<const S> plate_step, std::span<S> g,
                            std::span<S> blocks) const;
  /// The largest t <= 1 for which no tetrahedron's determinant gets below a tenth of what it is at x: the smallest
  /// positive root of a cubic per tetrahedron (Smith and Schaefer 2015). 0 if something is not finite.
  S longest_step(std::span<const S> x, std::span<const S> step) const;
  /// The smallest det F: not positive if a tetrahedron is inverted, NaN if a position is.
  S smallest_determinant(std::span<const S> x) const;

  /// Mean edge length at rest: the scale of the steps for which the linearisation holds.
  double mean_edge_mm() const { return mean_edge_mm_; }

 private:
  using V = simd::Vector<S>;
  static constexpr int kWidth = simd::kLanesOf<S>;
  // One tetrahedron per lane; the last batch repeats its last tetrahedron with weight 0. Nodes are in the order of
  // elimination, fixed ones last, so that every block of the Hessian lands in the lower pattern as it is.
  struct Batch {
    std::array<std::array<std::int32_t, kWidth>, 4> offset;  // 3 * node
    V B[9];
    V weight;
    // Where each tetrahedron's blocks of the Hessian go, in scalars; kNowhere for blocks of nodes that are not free.
    std::array<std::array<std::int32_t, 10>, kWidth> destination;
    std::int32_t couplings_end;
  };
  static constexpr std::int32_t kNowhere = -1;
  // A block (plate node, free node): its transpose times the plate's step acts on the free node. source counts scalars
  // from the start of the batch's H[90].
  struct Coupling {
    std::int32_t source, free_offset, plate_offset;
  };

  void add_batch(const ShapeModel& model, const Cholesky<S>* cholesky, std::span<const std::array<int, 4>> tets);
  void add_targets(const ShapeModel& model, const Cholesky<S>& cholesky, const std::array<int, 4>& tet, int lane,
                   Batch& batch);
  static void gather(const Batch& batch, std::span<const S> x, V F[9]);
  static void scatter(const Batch& batch, const V g[12], std::span<S> gradient);
  static void scatter_blocks(const Batch& batch, V H[90], std::span<S> blocks);

  std::vector<Batch> batches_;
  std::vector<Coupling> couplings_;
  double mean_edge_mm_ = 0;
};

extern template class Elements<float>;
extern template class Elements<double>;

}  // namespace finsight
