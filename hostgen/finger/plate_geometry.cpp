#include "hostgen/finger/plate_geometry.h"

#include <Eigen/Geometry>
#include <limits>

#include "hostgen/finger/front_face.h"
#include "hostgen/finger/grid.h"
#include "hostgen/finger/surface_finger.h"

namespace finsight::host {

std::array<double, 2> carried_y_mm(const FingerSpec& spec, int plate) {
  if (!spec.surface) return {plate_bottom_mm(spec, plate), spec.plates[plate].beam_y_mm + spec.beam_mm / 2};
  const Eigen::AlignedBox3d bounds = spec.surface->plate_bounds_mm(plate);
  return {bounds.min().y(), bounds.max().y()};
}

Eigen::Vector2d plate_half_size_mm(const FingerSpec& spec, int plate) {
  const PlateSpec& p = spec.plates[plate];
  const Eigen::Vector3d marker = p.T_finger_marker.translation();
  if (spec.surface) {  // as much of it as lies on all sides of the marker
    const Eigen::AlignedBox3d bounds = spec.surface->plate_bounds_mm(plate);
    const Eigen::Vector3d half = (marker - bounds.min()).cwiseMin(bounds.max() - marker);
    return {half.x(), half.z()};
  }
  const double depth_mm = inner_back_mm(spec, marker.y()) - inner_front_mm(spec, marker.y());
  return {inner_half_width_mm(spec, marker.y()) * (p.across[1] - p.across[0]) / 2,
          depth_mm * (p.deep[1] - p.deep[0]) / 2};
}

FrontPoint front_point(const FingerSpec& spec, double x_mm, double y_mm) {
  if (!spec.surface) {
    return {{x_mm, y_mm, spec.front_z.at(y_mm)}, Eigen::Vector3d(0, -spec.front_z.slope, 1).normalized()};
  }
  const TriangleSurface& surface = spec.surface->surface;
  FrontPoint best;
  double best_distance = std::numeric_limits<double>::infinity();
  for (const auto& [a, b, c] : spec.surface->front) {
    const std::array<Eigen::Vector3d, 3> corner = {surface.point_mm[a], surface.point_mm[b], surface.point_mm[c]};
    const Eigen::Vector3d at = point_at(corner, nearest_in_triangle(corner, x_mm, y_mm));
    const double distance = (at.head<2>() - Eigen::Vector2d(x_mm, y_mm)).squaredNorm();
    if (distance >= best_distance) continue;
    best_distance = distance;
    best = {at, (corner[2] - corner[0]).cross(corner[1] - corner[0]).normalized()};
  }
  return best;
}

}  // namespace finsight::host
