// Where every node of the finger is, under plates that are where their poses put them: never with an inverted
// tetrahedron. What the map tiers check their shapes with, and what Newton steps start from.
#pragma once

#include <span>
#include <vector>

#include "firmware/shape/elements.h"
#include "firmware/shape/rigid_plates.h"

namespace finsight {

/// S is float (the frame loop) or double (references). Nothing allocates or throws after the constructor.
template <class S>
class ShapeState {
 public:
  /// The finger at rest; `cholesky` is what Hessians are to be assembled for, if they are. Throws InputError if the
  /// model is inconsistent.
  ShapeState(const ShapeModel& model, const MountModel& mount, const Cholesky<S>* cholesky = nullptr);

  void start_at_rest();
  /// Continues from this shape [3 * nodes] with its plates there. False, and nothing happens, if it has an inverted
  /// tetrahedron or is not finite.
  bool start_from(std::span<const float> node_mm, const PlateMotions& plates);
  /// For a shape that start_from() refuses: goes from rest straight towards it, as far as no tetrahedron gets flat.
  void start_towards(std::span<const float> node_mm, const PlateMotions& plates);

  std::span<const S> node_mm() const { return x_; }
  /// Of the present shape; infinite if a tetrahedron is inverted or a position not finite.
  double energy() const { return elements_.energy(x_); }
  /// Of another shape [3 * nodes].
  double energy_of(std::span<const S> node_mm) const { return elements_.energy(node_mm); }
  S smallest_determinant() const { return elements_.smallest_determinant(x_); }
  /// Strained more than any touch can: the plates are where no finger has them.
  bool is_overstrained() const;
  double rest_energy() const { return rest_energy_; }
  const RigidPlates& rigid_plates() const { return rigid_plates_; }

 protected:
  Elements<S> elements_;
  RigidPlates rigid_plates_;
  std::vector<std::int32_t> free_offsets_;  // 3 * node of every free node, in the order of ShapeModel::free_index
  std::vector<S> rest_, x_, trial_, step_;
  PlateMotions plates_;  // where the plates are; nearly so after a step that was cut short

 private:
  void assemble_trial(std::span<const float> node_mm, const PlateMotions& plates);
  double rest_energy_ = 0;
};

extern template class ShapeState<float>;
extern template class ShapeState<double>;

}  // namespace finsight
