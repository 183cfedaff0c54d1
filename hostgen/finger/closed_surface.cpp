// Whether triangles form a closed surface: checks first every triangle, then every edge, every point, and the pieces.
// Each check relies on those before it, so the first fault found is the first one to fix.
#include <algorithm>
#include <map>

#include "firmware/input_error.h"
#include "hostgen/finger/tetgen.h"
#include "hostgen/finger/triangle_surface.h"

namespace finsight::host {

namespace {

using Eigen::Vector3d;

/// The triangles at an edge. `along` runs it from the lower point's index to the higher.
struct EdgeUse {
  std::size_t triangle = 0;
  bool along = false;
};
using Edges = std::map<std::pair<int, int>, std::vector<EdgeUse>>;

struct Check {
  const TriangleSurface& surface;
  const std::string& file;

  std::string triangle_text(std::size_t t) const {
    return "triangle " + std::to_string(t + 1) + " around " + place_text(surface.middle(t));
  }
  std::string edge_text(std::pair<int, int> edge) const {
    return "from " + place_text(surface.point_mm[edge.first]) + " to " + place_text(surface.point_mm[edge.second]);
  }
  [[noreturn]] void refuse(std::size_t count, const std::string& one, const std::string& many, const std::string& where,
                           const std::string& expected) const {
    throw InputError(file, "surface", std::to_string(count) + " " + (count == 1 ? one : many) + ", the first " + where,
                     expected);
  }

  void triangles() const;
  Edges edges() const;
  void orientation(const Edges& edges) const;
  void points() const;
  void intersections() const;
  void pieces(const Edges& edges) const;
};

void Check::triangles() const {
  constexpr double kFlat = 1e-9;  // height over longest side; a tetrahedron on it has no volume in double precision
  std::vector<std::size_t> flat, twice;
  std::map<std::array<int, 3>, std::size_t> seen;
  for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
    const auto corner = surface.corners(t);
    const double longest = std::max({(corner[1] - corner[0]).squaredNorm(), (corner[2] - corner[1]).squaredNorm(),
                                     (corner[0] - corner[2]).squaredNorm()});
    if (!(surface.twice_area(t).norm() > kFlat * longest)) flat.push_back(t);
    std::array<int, 3> key = surface.triangle[t];
    std::sort(key.begin(), key.end());
    if (!seen.emplace(key, t).second) twice.push_back(t);
  }
  if (!flat.empty())
    refuse(flat.size(), "triangle without area", "triangles without area", triangle_text(flat[0]),
           "none (merge or remove them)");
  if (!twice.empty()) {
    refuse(twice.size(), "duplicate triangle", "duplicate triangles", triangle_text(twice[0]), "every triangle once");
  }
}

Edges Check::edges() const {
  Edges edges;
  for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
    for (std::size_t i = 0; i < 3; ++i) {
      const int from = surface.triangle[t][i], to = surface.triangle[t][(i + 1) % 3];
      edges[std::minmax(from, to)].push_back({t, from < to});
    }
  }
  std::vector<std::pair<int, int>> open, crowded;
  for (const auto& [edge, uses] : edges) {
    if (uses.size() == 1) open.push_back(edge);
    if (uses.size() > 2) crowded.push_back(edge);
  }
  if (!open.empty()) {
    refuse(open.size(), "open edge", "open edges", edge_text(open[0]),
           "a closed surface, two triangles at every edge (fill the holes)");
  }
  if (!crowded.empty()) {
    refuse(crowded.size(), "edge with more than two triangles", "edges with more than two triangles",
           edge_text(crowded[0]),
           "two triangles at every edge (parts of a solid touch in faces, not in edges; inner walls are not wanted)");
  }
  return edges;
}

/// Edge-connected pieces, and which triangles face the opposite way to the first of their piece.
struct Pieces {
  std::vector<int> piece;    // per triangle
  std::vector<bool> turned;  // per triangle
  int count = 0;
};

Pieces find_pieces(const TriangleSurface& surface, const Edges& edges) {
  Pieces result{std::vector<int>(surface.triangle.size(), -1), std::vector<bool>(surface.triangle.size()), 0};
  for (std::size_t first = 0; first < surface.triangle.size(); ++first) {
    if (result.piece[first] >= 0) continue;
    std::vector<std::size_t> open = {first};
    result.piece[first] = result.count;
    while (!open.empty()) {
      const std::size_t t = open.back();
      open.pop_back();
      for (std::size_t i = 0; i < 3; ++i) {
        const auto& uses = edges.at(std::minmax(surface.triangle[t][i], surface.triangle[t][(i + 1) % 3]));
        const std::size_t other = uses[0].triangle == t ? uses[1].triangle : uses[0].triangle;
        if (result.piece[other] >= 0) continue;
        result.piece[other] = result.count;
        result.turned[other] = result.turned[t] != (uses[0].along == uses[1].along);
        open.push_back(other);
      }
    }
    ++result.count;
  }
  return result;
}

void Check::orientation(const Edges& edges) const {
  const bool consistent = std::all_of(edges.begin(), edges.end(),
                                      [](const auto& edge) { return edge.second[0].along != edge.second[1].along; });
  if (consistent) return;
  const Pieces pieces = find_pieces(surface, edges);
  std::vector<std::size_t> flipped;
  for (int piece = 0; piece < pieces.count; ++piece) {  // in each piece, the minority
    std::vector<std::size_t> sides[2];
    for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
      if (pieces.piece[t] == piece) sides[pieces.turned[t]].push_back(t);
    }
    const auto& fewer = sides[sides[1].size() <= sides[0].size()];
    flipped.insert(flipped.end(), fewer.begin(), fewer.end());
  }
  if (flipped.empty()) throw InputError(file, "surface", "a one-sided surface", "one with an inside and an outside");
  refuse(flipped.size(), "flipped triangle", "flipped triangles",
         triangle_text(*std::min_element(flipped.begin(), flipped.end())),
         "all facing outward, as their neighbours do");
}

/// Around a point, the triangles must be one fan: two cones that meet at their tips are not a solid.
void Check::points() const {
  std::vector<std::map<int, int>> next(surface.point_mm.size());  // of the corners around a point
  for (const auto& corner : surface.triangle) {
    for (std::size_t i = 0; i < 3; ++i) next[corner[i]][corner[(i + 1) % 3]] = corner[(i + 2) % 3];
  }
  std::vector<std::size_t> pinched;
  for (std::size_t point = 0; point < next.size(); ++point) {
    if (next[point].empty()) continue;
    const int first = next[point].begin()->first;
    std::size_t steps = 0;
    for (int at = first; steps == 0 || at != first; ++steps) at = next[point].at(at);
    if (steps != next[point].size()) pinched.push_back(point);
  }
  if (!pinched.empty()) {
    refuse(pinched.size(), "point where parts touch only at their tips", "points where parts touch only at their tips",
           "at " + place_text(surface.point_mm[pinched[0]]), "parts that touch in faces");
  }
}

void Check::intersections() const {
  const std::vector<std::array<int, 3>> crossed = find_intersections(surface);
  if (crossed.empty()) return;
  const auto corner = [&](int i) { return surface.point_mm[crossed[0][i]]; };
  refuse(crossed.size(), "triangle that another cuts", "triangles that others cut",
         "around " + place_text((corner(0) + corner(1) + corner(2)) / 3),
         "a surface that does not pass through itself");
}

/// One piece is the solid; those that face the other way are hollows in it.
void Check::pieces(const Edges& edges) const {
  const Pieces pieces = find_pieces(surface, edges);
  std::vector<double> volume_mm3(static_cast<std::size_t>(pieces.count));
  std::vector<std::size_t> example(static_cast<std::size_t>(pieces.count));
  for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
    const auto [a, b, c] = surface.corners(t);
    volume_mm3[static_cast<std::size_t>(pieces.piece[t])] += a.dot(b.cross(c)) / 6;
    example[static_cast<std::size_t>(pieces.piece[t])] = t;
  }
  std::vector<std::size_t> solids;
  for (std::size_t piece = 0; piece < volume_mm3.size(); ++piece) {
    if (volume_mm3[piece] > 0) solids.push_back(piece);
  }
  if (solids.empty()) {
    throw InputError(file, "surface", "all " + std::to_string(surface.triangle.size()) + " triangles facing inward",
                     "a surface that is not inside out (flip all normals)");
  }
  if (solids.size() > 1) {
    throw InputError(file, "surface",
                     std::to_string(solids.size()) + " separate pieces, among them " +
                         triangle_text(example[solids[0]]) + " and " + triangle_text(example[solids[1]]),
                     "a finger in one piece (unite them)");
  }
  TriangleSurface solid{surface.point_mm, {}};
  for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
    if (pieces.piece[t] == static_cast<int>(solids[0])) solid.triangle.push_back(surface.triangle[t]);
  }
  for (std::size_t piece = 0; piece < example.size(); ++piece) {
    if (piece == solids[0] || winding_number(solid, surface.point_mm[surface.triangle[example[piece]][0]]) > 0.5)
      continue;
    throw InputError(file, "surface",
                     "a piece that faces inward but lies outside of the finger, with " + triangle_text(example[piece]),
                     "a finger in one piece");
  }
}

}  // namespace

void check_bounds_a_solid(const TriangleSurface& surface, const std::string& file) {
  const Check check{surface, file};
  check.triangles();
  const Edges edges = check.edges();
  check.orientation(edges);
  check.points();
  check.intersections();
  check.pieces(edges);
}

}  // namespace finsight::host
