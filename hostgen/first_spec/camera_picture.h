// What a camera inside a finger would see at rest: the finger's own walls, and the markers on its plates.
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "firmware/geometry/lens.h"
#include "hostgen/finger/triangle_surface.h"

namespace finsight::host {

struct PicturedMarker {
  Eigen::Isometry3d T_finger_marker = Eigen::Isometry3d::Identity();
  int id = 0;  ///< of DICT_4X4_50
  double size_mm = 0;
};

/// [height * width] grey levels: the surface lit from the camera, nearer parts in front of further ones, and the
/// markers with their white border wherever the surface does not hide them.
std::vector<std::uint8_t> camera_picture(const TriangleSurface& surface, const std::vector<PicturedMarker>& markers,
                                         const Eigen::Isometry3d& T_finger_camera, const Lens& lens);

}  // namespace finsight::host
