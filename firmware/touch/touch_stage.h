// PlatePoses -> Touch: features, then the int8 network.
#pragma once

#include <vector>

#include "firmware/model/model.h"

namespace finsight {

/// The published radius of a network's radius at this plate motion: TouchModel::radius_curve.
float calibrated_radius_mm(std::span<const float> curve, float plate_motion_mm, float radius_mm);

class TouchStage {
 public:
  explicit TouchStage(const Model& model) : TouchStage(model.touch) {}
  /// The arrays that `model` views must live as long as the stage.
  explicit TouchStage(const TouchModel& model);

  /// Never throws, never allocates. Invalid below the model's threshold of plate motion, beyond its range (then
  /// `over_range` says so), without any seen plate, and for non-finite poses; held poses repeat the last touch as held.
  /// Plates that are not seen must have been completed.
  ///
  /// radius_68_mm is the length of the network's three standard deviations (x, y, z). Were the errors normal, that ball
  /// would hold 68.3 % of them if they lay on a line and 63.2 % if they were round in a plane, the touched face;
  /// the model's radius curve makes it hold 68 % of the errors on held-out contact points, whatever the plate motion.
  const Touch& locate(const PlatePoses& poses);

 private:
  void run_network(const PlatePoses& poses);

  TouchModel model_;
  std::vector<float> hidden_[2];
  Touch touch_;
};

}  // namespace finsight
