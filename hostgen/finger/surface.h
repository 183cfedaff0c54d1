// The finger's surface as planar polygons (a piecewise linear complex), the input of TetGen.
#pragma once

#include <Eigen/Core>
#include <array>
#include <string>
#include <vector>

#include "hostgen/finger/grid.h"

namespace finsight::host {

/// One planar polygon with holes: outlines as indices of points, and a point inside each hole.
struct Facet {
  std::vector<std::vector<int>> outlines;
  std::vector<Eigen::Vector3d> holes_mm;
};

struct Surface {
  std::vector<Eigen::Vector3d> points_mm;
  std::vector<Facet> facets;
  std::vector<Eigen::Vector3d> seeds_mm;  ///< a point inside each region, by region number
};

/// Facets lie wherever two cells of different label meet, so the plates get facets of their own inside the body.
Surface make_surface(const FingerGrid& grid);

/// Everything that TetGen needs: of the spec's own surface where it has one, else of its walls and plates.
Surface finger_surface(const FingerSpec& spec);

/// From corner to corner along all outlines.
std::vector<std::array<Eigen::Vector3d, 2>> outline_edges(const Surface& surface);

/// In TetGen's .poly format.
std::string poly_text(const Surface& surface);

}  // namespace finsight::host
