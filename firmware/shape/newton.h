// The shape of the finger for given plates: the minimum of the symmetric Dirichlet energy with the base fixed and the
// plates moved rigidly, by a fixed number of Newton steps from the last shape.
#pragma once

#include <span>
#include <vector>

#include "firmware/shape/elements.h"
#include "firmware/shape/rigid_plates.h"

namespace finsight {

/// S is float (the frame loop) or double (references). Holds the present shape, which never has an inverted
/// tetrahedron. Nothing allocates or throws after the constructor.
template <class S>
class NewtonSolver {
 public:
  /// The finger at rest. Throws InputError if the model is inconsistent.
  NewtonSolver(const ShapeModel& model, const MountModel& mount);

  struct Outcome {
    bool ok = false;     ///< the plates are where they were asked to be, and all is finite
    int steps = 0;       ///< factorisations and chord steps
    S last_step_mm = 0;  ///< largest coordinate change of a free node in the last step: about the error before it
  };

  /// Moves the plates and takes `factorisations` Newton steps, each followed by `chord_steps` steps with the same
  /// factor. No step carries a plate further than plate_step_mm(), so a large motion costs more factorisations; so
  /// does a last step further than half of that, which a start far from the minimum brings. kMaxFactorisations at
  /// most. Not ok if the poses are not plausible or a pivot fails: then the shape stays as it was; or if the plates
  /// could not get there in time, for the distance or because a tetrahedron would invert: then the shape has gone part
  /// of the way.
  Outcome solve(const PlatePoses& poses, int factorisations, int chord_steps);
  /// Newton steps with line search until a step moves no coordinate further than `tolerance_mm`; not ok after
  /// `most_steps`.
  Outcome converge(const PlatePoses& poses, double tolerance_mm, int most_steps);

  void start_at_rest();
  /// Continues from this shape [3 * nodes], whose plates are at `poses`. False, and nothing happens, if it has an
  /// inverted tetrahedron or is not finite.
  bool start_from(std::span<const float> node_mm, const PlatePoses& poses);
  /// For a shape that start_from() refuses: goes from rest straight towards it, as far as no tetrahedron gets flat.
  void start_towards(std::span<const float> node_mm, const PlatePoses& poses);
  /// The plates move further than one solve() carries them. What a solver finds on the far side of such a motion can be
  /// another minimum than the one that a finger gets to.
  bool is_jump(const PlatePoses& from, const PlatePoses& to) const;

  std::span<const S> node_mm() const { return x_; }
  /// Of the present shape; infinite if a tetrahedron is inverted or a position not finite.
  double energy() const { return elements_.energy(x_); }
  /// Of another shape [3 * nodes].
  double energy_of(std::span<const S> node_mm) const { return elements_.energy(node_mm); }
  S smallest_determinant() const { return elements_.smallest_determinant(x_); }

  static constexpr int kMaxFactorisations = 6;
  /// How far a step may carry a node of a plate.
  double plate_step_mm() const;

 private:
  void assemble_trial(std::span<const float> node_mm, const PlateMotions& plates);
  double aim(const PlateMotions& target);
  double aim_at(const PlateMotions& plates);
  bool take_step(bool new_factor, bool search, Outcome& outcome);
  S search_line(S length, double slope);
  void move(S length);
  Outcome& fail(Outcome& outcome, const PlateMotions& plates_before);

  Cholesky<S> cholesky_;
  Elements<S> elements_;
  RigidPlates rigid_plates_;
  std::vector<S> rest_;
  std::vector<std::int32_t> free_offsets_;  // 3 * node of every free node
  std::vector<S> x_, before_, trial_, step_, gradient_, solution_;
  PlateMotions plates_;  // where the plates are; nearly so after a step that was cut short
  PlateMotions aim_;     // where the present step takes them
  bool aim_is_target_ = true, plates_move_ = false;
  bool plates_at_aim_ = true;
};

extern template class NewtonSolver<float>;
extern template class NewtonSolver<double>;

}  // namespace finsight
