// Closed surfaces made of triangles, as CAD programs export them: read, and checked that they bound a solid.
#pragma once

#include <Eigen/Core>
#include <array>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace finsight::host {

/// Corners are indices of points, counter-clockwise seen from outside.
struct TriangleSurface {
  std::vector<Eigen::Vector3d> point_mm;
  std::vector<std::array<int, 3>> triangle;
  std::map<std::string, std::vector<int>> labelled{};  ///< name of faces in the file -> their points

  std::array<Eigen::Vector3d, 3> corners(std::size_t t) const {
    return {point_mm[triangle[t][0]], point_mm[triangle[t][1]], point_mm[triangle[t][2]]};
  }
  Eigen::Vector3d middle(std::size_t t) const {
    const auto [a, b, c] = corners(t);
    return (a + b + c) / 3;
  }
  /// Twice the area, along the outward normal.
  Eigen::Vector3d twice_area(std::size_t t) const {
    const auto [a, b, c] = corners(t);
    return (b - a).cross(c - a);
  }
};

/// "(1, 2.5, 3) mm", for messages.
std::string place_text(const Eigen::Vector3d& at_mm);

/// Points of a file that are nearer than this to each other are one: only rounding made them several.
inline constexpr double kWeldMm = 1e-3;

/// Reads .stl (binary or ASCII), .ply or .obj (by its extension, in either case) whose numbers are in units of
/// `unit_mm`. Points within kWeldMm become one, and triangles that vanish by that are left out; a face of more than
/// three corners becomes a fan. OBJ's groups and STL's solids have names. Throws InputError.
TriangleSurface read_triangles(const std::filesystem::path& file, double unit_mm);

/// Takes out points as long as the surface stays within `tolerance_mm` of where it was: slivers and short edges of CAD
/// go, sharp edges stay. What is left are points of the surface. Expects two triangles at every edge.
void simplify(TriangleSurface& surface, double tolerance_mm);

/// How many triangles, and what makes them hard to fill with tetrahedra: the shortest edge and the thinnest triangle,
/// with places, for messages.
std::string hardness_text(const TriangleSurface& surface);

/// Throws InputError (file, number of faults, where the first is) unless the surface bounds one solid in one piece,
/// with or without closed hollows: no triangle without area or duplicated, two at every edge, all facing outward, none
/// cutting another.
void check_bounds_a_solid(const TriangleSurface& surface, const std::string& file);

/// How often the surface winds around a point that does not lie on it: 1 inside the solid, 0 outside and in its
/// hollows. Source: Van Oosterom and Strackee, "The solid angle of a plane triangle", 1983.
double winding_number(const TriangleSurface& surface, const Eigen::Vector3d& at_mm);

}  // namespace finsight::host
