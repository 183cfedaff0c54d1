// What is done with plate motions.
#pragma once

#include <Eigen/Geometry>

#include "firmware/types.h"

namespace finsight::host {

/// Half a millimetre per degree, the lever of a plate's edge: makes rotations comparable with displacements.
constexpr float kMillimetresPerRadian = 28.65f;

/// The part `t` (0: a, 1: b) of an even way from a to b, number by number.
inline PlateMotion on_the_way(const PlateMotion& a, const PlateMotion& b, float t) {
  return {a.displacement_mm + t * (b.displacement_mm - a.displacement_mm),
          a.rotation_rad + t * (b.rotation_rad - a.rotation_rad)};
}

/// A plate's frame (its marker's, in the finger frame) after a motion from `rest`.
inline Eigen::Isometry3d moved(const Eigen::Isometry3d& rest, const PlateMotion& motion) {
  const Eigen::Vector3d rotation = motion.rotation_rad.cast<double>();
  Eigen::Isometry3d now = rest;
  now.translation() += motion.displacement_mm.cast<double>();
  if (rotation.norm() > 0) now.linear() = Eigen::AngleAxisd(rotation.norm(), rotation.normalized()) * rest.linear();
  return now;
}

}  // namespace finsight::host
