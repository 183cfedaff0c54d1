// PlatePoses -> Touch: features, then the int8 network.
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "firmware/model/model.h"

namespace finsight {

/// The radius to publish for the network's own at this plate motion: TouchModel::radius_curve.
float calibrated_radius_mm(std::span<const float> curve, float plate_motion_mm, float radius_mm);

/// Of the plates that are seen (at least one): where their number stands in TouchModel::seen_factor.
std::size_t seen_index(const std::array<bool, kPlates>& seen);

/// What the noise of the poses does not hold of how far a touch may be off.
struct Doubt {
  float shaken_mm = 0;                    ///< see Shake
  float unknown_g = 0;                    ///< see Observation; of this the network knows
  bool is_from_rest = true;               ///< see Observation
  std::span<const PoseVector> changes{};  ///< of the motion, one standard deviation each; see MarkerPlaces
};

class TouchStage {
 public:
  /// Of the spread of what was learnt: with a larger standard deviation a component of force or moment is not told.
  static constexpr float kLargestTold = 0.8F;

  /// Also takes the finger's touched face from the model.
  explicit TouchStage(const Model& model);
  /// The arrays that `model` views must live as long as the stage.
  explicit TouchStage(const TouchModel& model, float largest_told = kLargestTold);

  /// Of a finger that was fitted, instead of the model's.
  void use_tolerances(float stiffness, float touch_mm, float noise_per_mm) {
    model_.stiffness_tolerance = stiffness;
    model_.touch_tolerance_mm = touch_mm;
    model_.noise_per_mm = noise_per_mm;
  }
  /// For a finger whose own touches are that much less like the pack's (log-odds).
  void explain_less_likely(float log_odds) { less_likely_ = log_odds; }

  /// The touch that these poses tell of, fresh or invalid; `motion` is pose_vector(poses). Never throws, never
  /// allocates. Invalid below the model's threshold of plate motion, beyond its range (then `over_range` says so),
  /// without any seen plate, for poses that are invalid or not finite, and where the network's answer is not a touch: a
  /// point further off the face than two radii, or a radius as large as the standard deviation of the touches in the
  /// training set; and where no touch of the model's scene explains the motion (then `unexplained` says so). Plates
  /// that are not seen must have been completed.
  ///
  /// radius_68_mm is the length of the network's three standard deviations (x, y, z). Were the errors normal, that ball
  /// would hold 68.3 % of them if they lay on a line and 63.2 % if they were round in a plane, the touched face; the
  /// model's radius curve makes it hold 68 % of the errors on held-out states, whatever the plate motion, its radius
  /// network about as many of every kind of touch, wider where something else may as well have moved the plates, and
  /// its factors do the same whichever plates are seen. Components of force and moment that the plates do not tell are
  /// NaN, with their deviations; force_n never is.
  ///
  /// A `doubt` widens the radius and the deviations: the network knows fingers that stand still and are zeroed, bent by
  /// touch and by gravity. For everything else that may have moved the plates the network is asked once more, with the
  /// plates moved by one standard deviation of it: six times after a zero, 18 times where there is no zero.
  Touch locate(const PlatePoses& poses, const PoseVector& motion, const Doubt& doubt);
  Touch locate(const PlatePoses& poses) { return locate(poses, pose_vector(poses), {}); }

 private:
  using Outputs = std::array<float, TouchModel::kOutputs>;
  /// What the network is told of how far to trust a motion.
  struct Trust {
    std::array<float, kPlates> noise;
    float unknown_g;
  };
  Trust trust_in(const PlatePoses& poses, float plate_motion_mm, float unknown_g) const;
  const Outputs& run_network(const Trust& trust, const PoseVector& motion);
  Touch read(const Outputs& outputs, float plate_motion_mm) const;  ///< the radius as the network has it
  float published_radius_mm(const Touch& touch, float unknown_g, const std::array<bool, kPlates>& seen) const;
  bool is_unexplained(const Touch& touch, float unknown_g) const;
  void read_forces(const Outputs& outputs, Touch& touch) const;
  void withhold_untold(Touch& touch) const;
  void widen(const Trust& trust, const PoseVector& motion, const Doubt& doubt, const std::array<bool, kPlates>& seen,
             Touch& touch);
  bool is_on_face(const Touch& touch) const;

  TouchModel model_;
  float largest_told_;
  float less_likely_ = 0;                                            // see explain_less_likely()
  Eigen::AlignedBox3f face_mm_;                                      ///< of the front face at rest; empty if not known
  std::array<std::vector<float>, TouchModel::kRounded + 1> hidden_;  // workspace: the hidden layers' activations
  Outputs outputs_{};
};

}  // namespace finsight
