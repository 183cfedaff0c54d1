// How gravity, or any other acceleration, moves the plates of the untouched finger, to first order.
#pragma once

#include <Eigen/Core>

#include "hostgen/fem/pushed_finger.h"

namespace finsight::host {

/// [18, 3] motions of the plates (mm, rad) for an acceleration field of 1 g along the finger's x, y and z, as gravity
/// is one. Throws std::runtime_error if the finger at rest does not resist every motion.
Eigen::Matrix<double, kPoseDims, 3> motion_per_g(const PushedFinger& finger);

}  // namespace finsight::host
