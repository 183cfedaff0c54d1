// Runs Debian's program `tetgen` (AGPL: run as a program, never linked).
#pragma once

#include <array>
#include <chrono>
#include <string>
#include <vector>

#include "hostgen/finger/triangle_surface.h"

namespace finsight::host {

/// What TetGen wrote. Tets have no particular orientation; some nodes may belong to no tet.
struct TetgenOutput {
  std::vector<std::array<double, 3>> nodes;
  std::vector<std::array<int, 4>> tets;
  std::vector<int> region;  ///< number of the region's seed, per tet
};

/// Meshes `poly` (TetGen's .poly format) with `switches` in a private temporary folder. Throws std::runtime_error if
/// the program is missing, fails, writes nonsense or needs longer than `limit` (it is killed then), Interrupted on
/// Ctrl-C.
TetgenOutput run_tetgen(const std::string& poly, const std::string& switches, std::chrono::milliseconds limit,
                        const std::string& program = "tetgen");

/// The triangles (as indices of points) that intersect another one anywhere except in common corners and edges. Throws
/// as run_tetgen() does.
std::vector<std::array<int, 3>> find_intersections(const TriangleSurface& surface);

}  // namespace finsight::host
