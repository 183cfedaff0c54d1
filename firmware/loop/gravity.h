// Takes out of the plate motions what gravity does to a finger that its arm turns.
#pragma once

#include <optional>

#include "firmware/model/model.h"
#include "firmware/touch/features.h"

namespace finsight {

/// The finger bends by its own weight. A zero absorbs that as it is when the zero is measured; after a turn of the
/// gripper the difference remains. How far 1 g moves the plates comes with the pack: at rest, and how that changes
/// as the finger bends.
class GravityCorrection {
 public:
  /// Left over where it is known, in g: two degrees of the arm's own error; and what bends the finger so far that the
  /// pack does not tell it, which grows with the square. `scripts/report scene` shows whether radii then hold.
  static constexpr float kKnown_g = 0.03F, kUntold_per_g = 0.04F;
  /// Where it is not known: two random directions differ by 0.82 g along each axis, opposite ones by 1.15 g.
  static constexpr float kUnknown_g = kMaxUnknown_g;

  /// `fixed_g`: the acceleration of things that fall, in the finger frame, where the finger never turns.
  GravityCorrection(const TouchModel& model, const std::optional<Vec3f>& fixed_g);

  /// What the arm says from now on; nothing: not known, or too old. Without effect where it is fixed.
  void set_felt(const std::optional<Vec3f>& g) {
    if (!is_fixed_) felt_g_ = g;
  }
  /// What was felt when the zero was measured; nothing if that is not known.
  const std::optional<Vec3f>& at_zero() const { return at_zero_g_; }
  void set_at_zero(const std::optional<Vec3f>& g) { at_zero_g_ = is_fixed_ ? felt_g_ : g; }
  const std::optional<Vec3f>& felt() const { return felt_g_; }

  /// Corrects poses that are relative to a zero if there `is_zeroed`, else to the model's rest, which is without
  /// gravity. Returns Observation::unknown_g.
  float apply(bool is_zeroed, PlatePoses& poses) const;

  /// How far `g` moves plates that stand at `from` (motion from the model's rest) without it.
  PoseVector bend(const PoseVector& from, const Vec3f& g) const;

 private:
  using PerG = Eigen::Matrix<float, kPoseDims, 3, Eigen::RowMajor>;

  PerG per_g_;
  Eigen::Matrix<float, 3 * kPoseDims, kBentFeatures, Eigen::RowMajor> change_;
  bool is_fixed_;
  std::optional<Vec3f> felt_g_, at_zero_g_;
};

}  // namespace finsight
