// The shape of the finger for given plates: the minimum of the symmetric Dirichlet energy with the base fixed and the
// plates moved rigidly, by a fixed number of Newton steps from the last shape.
#pragma once

#include <span>
#include <vector>

#include "firmware/shape/shape_state.h"

namespace finsight {

/// A base class, because the elements of the ShapeState are arranged for a factorisation that exists before them.
template <class S>
struct NewtonFactor {
  explicit NewtonFactor(const ShapeModel& model) : cholesky_(model.cholesky) {}
  Cholesky<S> cholesky_;
};

/// A shape that Newton steps improve. S is float (the frame loop) or double (references). Nothing allocates or throws
/// after the constructor.
template <class S>
class NewtonSolver : private NewtonFactor<S>, public ShapeState<S> {
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
  /// The same for plates that are plausible.
  Outcome solve(const PlateMotions& target, int factorisations, int chord_steps);
  /// Newton steps with line search until a step moves no coordinate further than `tolerance_mm`; not ok after
  /// `max_steps`.
  Outcome converge(const PlatePoses& poses, double tolerance_mm, int max_steps);

  /// The plates move further than one solve() carries them. Beyond such a motion the solver may find another minimum
  /// than the one that the finger reaches.
  bool is_jump(const PlateMotions& from, const PlateMotions& to) const;

  static constexpr int kMaxFactorisations = 6;
  /// How far a step may carry a node of a plate.
  double plate_step_mm() const;

 private:
  /// One step, first as it is planned, then as it was taken.
  struct Step {
    PlateMotions aim;             ///< where it takes the plates
    bool reaches_target = false;  ///< that is where they were asked to be, not only on the way there
    bool moves_plates = false;
    bool arrived = false;  ///< the plates are at the aim: the step was not cut short
  };
  enum class Kind { kNewton, kSearched, kChord };

  using NewtonFactor<S>::cholesky_;
  using ShapeState<S>::elements_;
  using ShapeState<S>::rigid_plates_;
  using ShapeState<S>::free_offsets_;
  using ShapeState<S>::x_;
  using ShapeState<S>::trial_;
  using ShapeState<S>::step_;
  using ShapeState<S>::plates_;

  Step plan(const PlateMotions& target);
  double aim_at(const PlateMotions& plates);
  bool take(Kind kind, Step& step, Outcome& outcome);
  S search_line(S length, double slope);
  Outcome go_back(Outcome outcome, const PlateMotions& plates);

  std::vector<S> before_, gradient_, solution_;
};

extern template class NewtonSolver<float>;
extern template class NewtonSolver<double>;

}  // namespace finsight
