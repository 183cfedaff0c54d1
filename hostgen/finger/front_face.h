// The touched face: which triangles of a surface belong to it, and the point on it above (x, y).
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "hostgen/finger/triangle_surface.h"

namespace finsight::host {

/// A triangle faces the front if its outward normal is within 60 degrees of -z.
bool faces_front(const Eigen::Vector3d& outward);

/// Among the triangles in the box that face the front, the edge-connected group with the largest area seen along z:
/// ascending indices, empty if there are none.
std::vector<std::size_t> front_patch(std::span<const Eigen::Vector3d> points,
                                     std::span<const std::array<int, 3>> triangles, const Eigen::AlignedBox3d& box);

/// Of the triangles with a positive area, the edge-connected group with the largest sum of areas: ascending indices.
std::vector<std::size_t> largest_patch(std::span<const std::array<int, 3>> triangles, std::vector<double> area);

/// Splits the triangles of the touched face that lie in the box in part only, and their neighbours, so that the box's
/// planes run along edges. Moves points nearer than kSnapMm to a plane onto it.
void cut_front_at_box(TriangleSurface& surface, const Eigen::AlignedBox3d& box);

/// Nearest point of the triangle to (x, y), seen along z, as barycentric coordinates; (x, y) itself if it is inside.
Eigen::Vector3d nearest_in_triangle(const std::array<Eigen::Vector3d, 3>& corner, double x, double y);

/// The point of the triangle with these barycentric coordinates.
inline Eigen::Vector3d point_at(const std::array<Eigen::Vector3d, 3>& corner, const Eigen::Vector3d& share) {
  return share[0] * corner[0] + share[1] * corner[1] + share[2] * corner[2];
}

}  // namespace finsight::host
