// PlatePoses -> Touch: features, then the int8 network.
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "firmware/model/model.h"

namespace finsight {

/// The radius to publish for the network's own at this plate motion: TouchModel::radius_curve.
float calibrated_radius_mm(std::span<const float> curve, float plate_motion_mm, float radius_mm);

class TouchStage {
 public:
  /// Also takes the finger's touched face from the model.
  explicit TouchStage(const Model& model);
  /// The arrays that `model` views must live as long as the stage.
  explicit TouchStage(const TouchModel& model);

  /// The touch that these poses tell of, fresh or invalid; `motion` is pose_vector(poses). Never throws, never
  /// allocates. Invalid below the model's threshold of plate motion, beyond its range (then `over_range` says so),
  /// without any seen plate, for poses that are invalid or not finite, and where the network's answer is not a touch: a
  /// point further off the face than two radii, or a radius as large as the standard deviation of the touches in the
  /// training set. Plates that are not seen must have been completed.
  ///
  /// radius_68_mm is the length of the network's three standard deviations (x, y, z). Were the errors normal, that ball
  /// would hold 68.3 % of them if they lay on a line and 63.2 % if they were round in a plane, the touched face;
  /// the model's radius curve makes it hold 68 % of the errors on held-out contact points, whatever the plate motion.
  /// `shaken_mm`, see Shake, widens the radius: the network knows fingers that stand still.
  Touch locate(const PlatePoses& poses, const PoseVector& motion, float shaken_mm);
  Touch locate(const PlatePoses& poses) { return locate(poses, pose_vector(poses), 0); }

 private:
  Touch run_network(const PlatePoses& poses, const PoseVector& motion, float plate_motion_mm, float shaken_mm);
  void read_forces(std::span<const float, TouchModel::kOutputs> outputs, Touch& touch) const;
  bool is_on_face(const Touch& touch) const;

  TouchModel model_;
  Eigen::AlignedBox3f face_mm_;   ///< of the front face at rest; empty if not known
  std::vector<float> hidden_[2];  // workspace: the hidden layers' activations
};

}  // namespace finsight
