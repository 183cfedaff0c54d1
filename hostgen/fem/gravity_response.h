// How gravity, or any other acceleration, moves the plates.
#pragma once

#include <memory>

#include "hostgen/fem/statics.h"

namespace finsight::host {

struct GravityResponse {
  MotionPerG at_rest;
  /// Row 3 i + axis: how motion i for 1 g along that axis changes as the finger bends, for a unit of each of
  /// bent_features().
  using Change = Eigen::Matrix<double, 3 * kPoseDims, kBentFeatures, Eigen::RowMajor>;
  Change change = Change::Zero();
};

/// `change` is fitted to touches of the scene at `places` places of the face, of fingers that feel up to 3 g besides,
/// by the tangents there. Throws std::runtime_error if the finger at rest does not resist every motion.
GravityResponse gravity_response(const std::shared_ptr<const PushedFinger>& finger, const Scene& scene, int places);

}  // namespace finsight::host
