// Where markers can go on a surface from CAD.
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "hostgen/finger/triangle_surface.h"

namespace finsight::host {

inline constexpr double kCameraBelow_mm = 22;    ///< of the camera that looks up, from the base
inline constexpr double kMarkerShare = 3.0 / 4;  ///< of a plate's smaller side: the rest is the marker's white border

/// A level underside on which a marker fits, with the box that cuts a plate off above it.
struct PlateGuess {
  Eigen::AlignedBox3d box_mm;  ///< joined at +y
  Eigen::Vector3d marker_mm = Eigen::Vector3d::Zero();
  double room_mm = 0;    ///< the smaller side of the underside
  bool visible = false;  ///< from the camera, at rest
};

/// At most three, from the top down: visible ones first, as far apart in height as there are. Expects the finger frame.
std::vector<PlateGuess> best_plates(const TriangleSurface& surface);

}  // namespace finsight::host
