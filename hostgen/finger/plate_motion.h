// Where plates are once they have moved.
#pragma once

#include <Eigen/Geometry>

#include "firmware/geometry/so3.h"
#include "firmware/types.h"
#include "hostgen/finger/spec.h"

namespace finsight::host {

/// A frame after a displacement and a rotation vector (radians) about its own origin, both in the parent's axes.
inline Eigen::Isometry3d moved(const Eigen::Isometry3d& rest, const Eigen::Vector3d& displacement_mm,
                               const Eigen::Vector3d& rotation_rad) {
  Eigen::Isometry3d now = rest;
  now.translation() += displacement_mm;
  now.linear() = so3_exp(rotation_rad) * rest.linear();
  return now;
}

/// Where the camera has a plate's marker that has moved.
inline Eigen::Isometry3d T_camera_marker(const FingerSpec& spec, std::size_t plate, const PlateMotion& motion) {
  return spec.T_finger_camera.inverse() * moved(spec.plates[plate].T_finger_marker,
                                                motion.displacement_mm.cast<double>(),
                                                motion.rotation_rad.cast<double>());
}

}  // namespace finsight::host
