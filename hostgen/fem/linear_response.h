// How the plates of the unloaded finger answer to forces, to first order: any load of its face, and gravity, in a few
// microseconds.
#pragma once

#include <Eigen/Core>

#include "hostgen/fem/pushed_finger.h"

namespace finsight::host {

/// Constant after construction.
class LinearResponse {
 public:
  using Numbers = PoseVectorOf<double>;

  /// Solves 18 systems to double precision: some seconds. `finger` must outlive this.
  explicit LinearResponse(const PushedFinger& finger);

  /// Motions of the plates (mm, rad) for a force (N) at a point of the face.
  Numbers of(const FacePoint& at, const Eigen::Vector3d& force_n) const;
  /// [18, 3] motions for an acceleration field of 1 g along the finger's x, y and z, as gravity is one.
  const Eigen::Matrix<double, kPoseDims, 3>& per_g() const { return per_g_; }

 private:
  const PushedFinger& finger_;
  Eigen::Matrix<double, Eigen::Dynamic, kPoseDims, Eigen::RowMajor> by_force_;  ///< of every force on a free node
  Eigen::Matrix<double, kPoseDims, 3> per_g_;
};

}  // namespace finsight::host
