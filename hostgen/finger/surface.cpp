// On every grid plane, faces between the same two labels are merged into one polygon and only true corners are kept:
// every superfluous vertex would force small tetrahedra.
#include "hostgen/finger/surface.h"

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <map>
#include <set>
#include <utility>

#include "hostgen/finger/surface_finger.h"

namespace finsight::host {

namespace {

using Corner = std::array<int, 3>;  // grid point (i, j, k)
using Spot = std::array<int, 2>;    // grid point or cell (u, v) of one plane

/// Faces of one grid plane that touch and lie between the same two labels.
struct Patch {
  int axis = 0, plane = 0;
  std::set<Spot> faces;

  Corner corner(Spot spot) const {
    Corner result;
    result[axis] = plane;
    result[(axis + 1) % 3] = spot[0];
    result[(axis + 2) % 3] = spot[1];
    return result;
  }
};

/// The labels on both sides of a face; equal ones need no facet.
std::pair<int, int> sides(const FingerGrid& grid, const Patch& plane, Spot face) {
  Corner cell = plane.corner(face);
  const int above = grid.label(cell);
  --cell[plane.axis];
  return {grid.label(cell), above};
}

std::vector<Patch> patches_of_plane(const FingerGrid& grid, int axis, int plane) {
  std::vector<Patch> patches;
  const Patch empty{axis, plane, {}};
  std::set<Spot> seen;
  for (int v = 0; v < grid.cells((axis + 2) % 3); ++v) {
    for (int u = 0; u < grid.cells((axis + 1) % 3); ++u) {
      const auto labels = sides(grid, empty, {u, v});
      if (labels.first == labels.second || !seen.insert({u, v}).second) continue;
      Patch patch = empty;
      std::vector<Spot> open = {{u, v}};
      while (!open.empty()) {  // flood fill; outside the grid both sides are air, so it stops there
        const auto [a, b] = open.back();
        open.pop_back();
        patch.faces.insert({a, b});
        for (const Spot next : {Spot{a + 1, b}, Spot{a - 1, b}, Spot{a, b + 1}, Spot{a, b - 1}}) {
          if (sides(grid, patch, next) == labels && seen.insert(next).second) open.push_back(next);
        }
      }
      patches.push_back(std::move(patch));
    }
  }
  return patches;
}

/// Border of a patch as closed chains of grid points with the patch on the left; chains that meet in a point stay
/// apart.
std::vector<std::vector<Spot>> outlines(const Patch& patch) {
  std::multimap<Spot, Spot> edges;
  for (const auto [u, v] : patch.faces) {
    if (!patch.faces.contains({u, v - 1})) edges.insert({{u, v}, {u + 1, v}});
    if (!patch.faces.contains({u + 1, v})) edges.insert({{u + 1, v}, {u + 1, v + 1}});
    if (!patch.faces.contains({u, v + 1})) edges.insert({{u + 1, v + 1}, {u, v + 1}});
    if (!patch.faces.contains({u - 1, v})) edges.insert({{u, v + 1}, {u, v}});
  }
  std::vector<std::vector<Spot>> chains;
  while (!edges.empty()) {
    const Spot start = edges.begin()->first;
    std::vector<Spot> chain = {start};
    auto edge = edges.begin();
    while (true) {
      const Spot from = edge->first, to = edge->second;
      edges.erase(edge);
      if (to == start) break;
      chain.push_back(to);
      const auto turn_left = [&](Spot next) {
        return (to[0] - from[0]) * (next[1] - to[1]) - (to[1] - from[1]) * (next[0] - to[0]) > 0;
      };
      const auto [first, last] = edges.equal_range(to);
      edge = std::find_if(first, last, [&](const auto& candidate) { return turn_left(candidate.second); });
      if (edge == last) edge = first;
    }
    chains.push_back(std::move(chain));
  }
  return chains;
}

bool is_bend(Spot a, Spot b, Spot c) { return b[0] - a[0] != c[0] - b[0] || b[1] - a[1] != c[1] - b[1]; }

/// Twice the signed area: negative for the border of a hole.
int signed_area(const std::vector<Spot>& chain) {
  int area = 0;
  for (std::size_t i = 0; i < chain.size(); ++i) {
    const Spot a = chain[i], b = chain[(i + 1) % chain.size()];
    area += a[0] * b[1] - b[0] * a[1];
  }
  return area;
}

/// The middle of the face to the right of a hole's first edge, which is inside the hole.
Eigen::Vector3d hole_point_mm(const FingerGrid& grid, const Patch& patch, const std::vector<Spot>& chain) {
  const Spot a = chain[0], b = chain[1];
  const int du = b[0] - a[0], dv = b[1] - a[1];
  const Spot face = {std::min(a[0], b[0]) - (dv < 0 ? 1 : 0), std::min(a[1], b[1]) - (du > 0 ? 1 : 0)};
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Spot step : {Spot{0, 0}, Spot{1, 0}, Spot{0, 1}, Spot{1, 1}}) {
    sum += grid.point(patch.corner({face[0] + step[0], face[1] + step[1]}));
  }
  return sum / 4;
}

void append(std::string& text, const char* format, ...) {
  char line[160];
  va_list arguments;
  va_start(arguments, format);
  std::vsnprintf(line, sizeof line, format, arguments);
  va_end(arguments);
  text += line;
}

}  // namespace

Surface make_surface(const FingerGrid& grid) {
  struct Outlined {
    Patch patch;
    std::vector<std::vector<Spot>> chains;
  };
  std::vector<Outlined> outlined;
  for (int axis = 0; axis < 3; ++axis) {
    for (int plane = 0; plane <= grid.cells(axis); ++plane) {
      for (Patch& patch : patches_of_plane(grid, axis, plane)) {
        auto chains = outlines(patch);
        outlined.push_back({std::move(patch), std::move(chains)});
      }
    }
  }
  // A point is kept in every polygon that runs through it as soon as one polygon bends there; otherwise two polygons
  // would meet along an edge that only one of them has.
  std::set<Corner> bends;
  for (const auto& [patch, chains] : outlined) {
    for (const auto& chain : chains) {
      const std::size_t n = chain.size();
      for (std::size_t i = 0; i < n; ++i) {
        if (is_bend(chain[(i + n - 1) % n], chain[i], chain[(i + 1) % n])) bends.insert(patch.corner(chain[i]));
      }
    }
  }
  Surface surface;
  std::map<Corner, int> point_index;
  for (const Corner& corner : bends) {
    point_index[corner] = static_cast<int>(surface.points_mm.size());
    surface.points_mm.push_back(grid.point(corner));
  }
  for (const auto& [patch, chains] : outlined) {
    Facet facet;
    for (const auto& chain : chains) {
      std::vector<int>& outline = facet.outlines.emplace_back();
      for (const Spot spot : chain) {
        const auto found = point_index.find(patch.corner(spot));
        if (found != point_index.end()) outline.push_back(found->second);
      }
      if (signed_area(chain) < 0) facet.holes_mm.push_back(hole_point_mm(grid, patch, chain));
    }
    surface.facets.push_back(std::move(facet));
  }
  // Body and plates are in one piece each, so any cell of a label will do as its seed. No hollow is closed (the sides
  // are open), so TetGen needs no hint what is outside.
  for (int label = kBody; label < kFirstPlate + kPlates; ++label) {
    const auto cell = static_cast<int>(std::find(grid.labels.begin(), grid.labels.end(), label) - grid.labels.begin());
    const int nx = grid.cells(0), ny = grid.cells(1);
    surface.seeds_mm.push_back(grid.middle({cell % nx, cell / nx % ny, cell / (nx * ny)}));
  }
  return surface;
}

Surface finger_surface(const FingerSpec& spec) {
  return spec.surface ? spec.surface->tetgen_input() : make_surface(make_grid(spec));
}

std::vector<std::array<Eigen::Vector3d, 2>> outline_edges(const Surface& surface) {
  std::vector<std::array<Eigen::Vector3d, 2>> edges;
  for (const Facet& facet : surface.facets) {
    for (const std::vector<int>& outline : facet.outlines) {
      for (std::size_t c = 0; c < outline.size(); ++c) {
        edges.push_back({surface.points_mm[static_cast<std::size_t>(outline[c])],
                         surface.points_mm[static_cast<std::size_t>(outline[(c + 1) % outline.size()])]});
      }
    }
  }
  return edges;
}

std::string poly_text(const Surface& surface) {
  std::string text;
  append(text, "%zu 3 0 0\n", surface.points_mm.size());
  for (std::size_t i = 0; i < surface.points_mm.size(); ++i) {
    const Eigen::Vector3d& p = surface.points_mm[i];
    append(text, "%zu %.17g %.17g %.17g\n", i, p.x(), p.y(), p.z());
  }
  append(text, "%zu 0\n", surface.facets.size());
  for (const Facet& facet : surface.facets) {
    append(text, "%zu %zu\n", facet.outlines.size(), facet.holes_mm.size());
    for (const auto& outline : facet.outlines) {
      append(text, "%zu", outline.size());
      for (const int point : outline) append(text, " %d", point);
      text += "\n";
    }
    for (std::size_t i = 0; i < facet.holes_mm.size(); ++i) {
      const Eigen::Vector3d& p = facet.holes_mm[i];
      append(text, "%zu %.17g %.17g %.17g\n", i, p.x(), p.y(), p.z());
    }
  }
  append(text, "0\n%zu\n", surface.seeds_mm.size());
  for (std::size_t i = 0; i < surface.seeds_mm.size(); ++i) {
    const Eigen::Vector3d& p = surface.seeds_mm[i];
    append(text, "%zu %.17g %.17g %.17g %zu\n", i, p.x(), p.y(), p.z(), i);
  }
  return text;
}

}  // namespace finsight::host
