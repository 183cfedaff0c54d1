// Plate motions -> the positions of all nodes by regression, without a solve: tier map, the start after a gap, and the
// answer when the solve fails.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "firmware/model/model.h"

namespace finsight {

class ShapeMap {
 public:
  /// Views the model, which must outlive it. Throws InputError if the map's sizes do not fit the shape.
  ShapeMap(const ShapeMapModel& map, const ShapeModel& shape);

  /// Writes [3 * nodes] positions. The nodes of the plates are only nearly rigid (RigidPlates::place() corrects that).
  /// Does not allocate.
  void evaluate(const PoseVector& motion, std::span<float> node_mm) const;

  /// Whether the plates move about as far as in the training, each component by itself. Beyond that the quadratic
  /// terms extrapolate.
  bool covers(const PoseVector& motion) const;

  /// [rank]: how much of each basis vector the shape has; valid until the next call. Does not allocate.
  std::span<const float> coefficients(const PoseVector& motion) const;

 private:
  ShapeMapModel map_;
  std::span<const float> rest_mm_;
  mutable std::vector<float> coefficients_;  // [rank]
};

}  // namespace finsight
