// Cuts a rigid plate off a finger's surface: within its box the plate is free except at one face of the box, where it
// is joined.
#pragma once

#include <Eigen/Geometry>
#include <string>

#include "hostgen/finger/surface.h"
#include "hostgen/finger/triangle_surface.h"

namespace finsight::host {

/// Everything of the finger inside the box is the plate.
struct PlateBox {
  Eigen::AlignedBox3d box_mm;
  int axis = 1, side = 1;  ///< the box's face at which the plate is joined to the finger: 0 1 2 for x y z, -1 or 1
};

/// Points nearer than this to a plane of a box are moved onto it: only rounding kept them off it.
inline constexpr double kSnapMm = 1e-3;
void snap_to_box(TriangleSurface& surface, const Eigen::AlignedBox3d& box_mm);

/// The polygon on the box's joined face with the finger on both sides of it. Triangles that cross it are split, so that
/// it meets the surface in common points and edges. Expects snapped points. Throws InputError(file, field, ...) if
/// there is no such polygon or it reaches beyond the box.
Facet cut_at_joined_face(TriangleSurface& surface, const PlateBox& plate, const std::string& file,
                         const std::string& field);

/// The triangles of the plate's surface, ascending. Throws InputError if the surface passes through another face of the
/// box, or the box is empty.
std::vector<std::size_t> plate_triangles(const TriangleSurface& surface, const PlateBox& plate, const std::string& file,
                                         const std::string& field);

}  // namespace finsight::host
