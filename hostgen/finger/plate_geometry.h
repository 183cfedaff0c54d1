// What markers and images need to know about a plate, for parametric fingers and surfaces alike.
#pragma once

#include "hostgen/finger/spec.h"

namespace finsight::host {

/// Lowest and highest point that move rigidly with the plate: its lower face, and its crossbeam's top if that is known.
std::array<double, 2> carried_y_mm(const FingerSpec& spec, int plate);

/// Half the size of the plate's lower face along x and z, with the marker in its middle.
Eigen::Vector2d plate_half_size_mm(const FingerSpec& spec, int plate);

/// A point of the undeformed touched face, and the unit normal there that points into the finger.
struct FrontPoint {
  Eigen::Vector3d at_mm = Eigen::Vector3d::Zero(), inward = Eigen::Vector3d::Zero();
};
/// The point of the undeformed touched face above (x, y); off the face, that of its plane or of its nearest edge.
FrontPoint front_point(const FingerSpec& spec, double x_mm, double y_mm);
inline Eigen::Vector3d front_point_mm(const FingerSpec& spec, double x_mm, double y_mm) {
  return front_point(spec, x_mm, y_mm).at_mm;
}

}  // namespace finsight::host
