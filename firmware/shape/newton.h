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
  /// factor. A large motion is split and costs more factorisations, kMostFactorisations at most. Not ok if the poses
  /// are not plausible or a pivot fails: then the shape stays as it was; or if the plates could not get there in time
  /// without inverting a tetrahedron: then the shape has gone part of the way.
  Outcome solve(const PlatePoses& poses, int factorisations, int chord_steps);
  /// Newton steps with line search until a step moves no coordinate further than `tolerance_mm`; not ok after
  /// `most_steps`.
  Outcome converge(const PlatePoses& poses, double tolerance_mm, int most_steps);

  void start_at_rest();
  /// Continues from this shape [3 * nodes], whose plates are at `poses`. False, and nothing happens, if it has an
  /// inverted tetrahedron or is not finite.
  bool start_from(std::span<const float> node_mm, const PlatePoses& poses);

  std::span<const S> node_mm() const { return x_; }
  double energy() const { return elements_.energy(x_); }
  S smallest_determinant() const { return elements_.smallest_determinant(x_); }

  static constexpr int kMostFactorisations = 6;

 private:
  double aim(const PlateMotions& plates);
  int parts_of(double distance_mm) const;
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
  bool plates_at_aim_ = true;
};

extern template class NewtonSolver<float>;
extern template class NewtonSolver<double>;

}  // namespace finsight
