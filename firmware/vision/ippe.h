// Both poses that a square seen by a camera can have: Collins & Bartoli, "Infinitesimal plane-based pose estimation",
// IJCV 2014. By hand, because OpenCV's returns not-a-number or a pose that does not fit for squares seen exactly
// face-on, which is how the camera sees the markers of a finger at rest.
#pragma once

#include <Eigen/Geometry>
#include <array>

namespace finsight {

/// Lines of sight of a marker's corners, (X / Z, Y / Z) in the camera frame, clockwise from its top left corner.
using MarkerRays = std::array<Eigen::Vector2d, 4>;

/// A marker's corner in its own frame: origin at its centre, x right, y up, z out of the print.
Eigen::Vector3d marker_corner(double size_mm, std::size_t corner);

/// The two T_camera_marker under which a square of this size is seen along these rays; the one that fits better first.
/// Rays that do not span a square in front of the camera, or are not finite, give none.
struct SquarePoses {
  std::array<Eigen::Isometry3d, 2> T_camera_marker;
  int count = 0;
};
SquarePoses poses_of_square(const MarkerRays& rays, double size_mm);

}  // namespace finsight
