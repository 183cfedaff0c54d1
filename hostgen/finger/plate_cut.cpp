// A point on the plane of the cut counts as beyond it. So the section is that of a plane just before it, in the limit,
// and runs along edges that lie in the plane. Where the plate ends in the plane, its surface lies in the plane too and
// is taken off the section: what is left has the finger on both sides. All is done on edges between numbered points;
// coordinates only decide on which side of the plane a point lies.
#include "hostgen/finger/plate_cut.h"

#include <algorithm>
#include <array>
#include <map>
#include <set>

#include "firmware/input_error.h"

namespace finsight::host {

namespace {

using Eigen::Vector3d;

std::string face_name(const PlateBox& plate) { return std::string(plate.side > 0 ? "+" : "-") + "xyz"[plate.axis]; }

std::string reach_text(const TriangleSurface& surface) {
  Vector3d low = surface.point_mm.front(), high = low;
  for (const Vector3d& point : surface.point_mm) {
    low = low.cwiseMin(point);
    high = high.cwiseMax(point);
  }
  return "from " + place_text(low) + " to " + place_text(high);
}

class Cutter {
 public:
  Cutter(TriangleSurface& surface, const PlateBox& plate) : surface_(surface), plate_(plate) {
    plane_mm_ = (plate.side > 0 ? plate.box_mm.max() : plate.box_mm.min())[plate.axis];
  }

  /// Adds the part of the section that triangle `t` makes, and splits it. False if the part leaves the box.
  bool cut(std::size_t t);
  /// The section's outlines, the finger on the left seen from beyond the plane.
  std::vector<std::vector<int>> outlines() const;

 private:
  double beyond_mm(int point) const { return plate_.side * (surface_.point_mm[point][plate_.axis] - plane_mm_); }
  bool before(int point) const { return beyond_mm(point) < 0; }
  bool in_box(const Vector3d& on_plane) const {
    for (int i = 0; i < 3; ++i) {
      if (i == plate_.axis) continue;
      if (on_plane[i] < plate_.box_mm.min()[i] || on_plane[i] > plate_.box_mm.max()[i]) return false;
    }
    return true;
  }
  Vector3d crossing_mm(int a, int b) const;
  int crossing(int a, int b);
  void add(int from, int to) {
    if (segments_.erase({to, from}) == 0) segments_.insert({from, to});
  }
  void take_off_surface_in_plane(const std::array<int, 3>& corner);
  void split(std::size_t t);

  TriangleSurface& surface_;
  const PlateBox& plate_;
  double plane_mm_ = 0;
  std::map<std::pair<int, int>, int> crossing_;  // by edge
  std::set<std::pair<int, int>> segments_;       // from, to
};

/// Where an edge meets the plane; its corner, if that lies on it.
Vector3d Cutter::crossing_mm(int a, int b) const {
  const auto [low, high] = std::minmax(a, b);  // the same bits from both triangles at the edge
  for (const int corner : {low, high}) {
    if (beyond_mm(corner) == 0) return surface_.point_mm[corner];
  }
  const Vector3d &from = surface_.point_mm[low], &to = surface_.point_mm[high];
  const int axis = plate_.axis;
  Vector3d at = from + (plane_mm_ - from[axis]) / (to[axis] - from[axis]) * (to - from);
  at[axis] = plane_mm_;
  return at;
}

int Cutter::crossing(int a, int b) {
  for (const int corner : {a, b}) {
    if (beyond_mm(corner) == 0) return corner;
  }
  const auto [place, added] = crossing_.try_emplace(std::minmax(a, b), static_cast<int>(surface_.point_mm.size()));
  if (added) surface_.point_mm.push_back(crossing_mm(a, b));
  return place->second;
}

/// The plate ends at a triangle that lies in the plane and faces beyond it.
void Cutter::take_off_surface_in_plane(const std::array<int, 3>& corner) {
  for (const int point : corner) {
    if (beyond_mm(point) != 0 || !in_box(surface_.point_mm[point])) return;
  }
  for (std::size_t i = 0; i < 3; ++i) add(corner[(i + 1) % 3], corner[i]);
}

bool Cutter::cut(std::size_t t) {
  const std::array<int, 3> corner = surface_.triangle[t];
  const auto count = std::count_if(corner.begin(), corner.end(), [&](int point) { return before(point); });
  if (count == 0 && plate_.side * surface_.twice_area(t)[plate_.axis] > 0) take_off_surface_in_plane(corner);
  if (count == 0 || count == 3) return true;
  std::array<int, 2> down{}, up{};  // the edges that cross, from beyond and to beyond
  for (std::size_t i = 0; i < 3; ++i) {
    const int from = corner[i], to = corner[(i + 1) % 3];
    if (before(from) != before(to)) (before(to) ? down : up) = {from, to};
  }
  const bool down_inside = in_box(crossing_mm(down[0], down[1])), up_inside = in_box(crossing_mm(up[0], up[1]));
  if (!down_inside && !up_inside) return true;
  if (down_inside != up_inside) return false;
  const int from = crossing(down[0], down[1]), to = crossing(up[0], up[1]);
  if (from == to) return true;  // touches the plane with a corner
  add(from, to);
  split(t);
  return true;
}

/// Replaces a triangle by its parts on both sides of the plane.
void Cutter::split(std::size_t t) {
  const std::array<int, 3> corner = surface_.triangle[t];
  std::vector<int> parts[2];  // outlines: before, beyond
  for (std::size_t i = 0; i < 3; ++i) {
    const int from = corner[i], to = corner[(i + 1) % 3];
    parts[!before(from)].push_back(from);
    if (before(from) == before(to)) continue;
    const int at = crossing(from, to);
    for (std::vector<int>& part : parts) {
      if (at != from && at != to) part.push_back(at);
    }
    if (at == from || at == to) parts[0].push_back(at);
  }
  if (parts[1].size() < 3) return;  // only an edge of it lies in the plane
  bool first = true;
  for (const std::vector<int>& part : parts) {
    for (std::size_t i = 2; i < part.size(); ++i) {
      const std::array<int, 3> piece = {part[0], part[i - 1], part[i]};
      if (first) surface_.triangle[t] = piece;
      if (!first) surface_.triangle.push_back(piece);
      first = false;
    }
  }
}

std::vector<std::vector<int>> Cutter::outlines() const {
  std::multimap<int, int> next(segments_.begin(), segments_.end());
  std::vector<std::vector<int>> outlines;
  while (!next.empty()) {
    std::vector<int>& outline = outlines.emplace_back();
    for (auto at = next.begin(); at != next.end(); at = next.find(outline.back())) {
      if (outline.empty()) outline.push_back(at->first);
      const int to = at->second;
      next.erase(at);
      if (to == outline.front()) break;
      outline.push_back(to);
    }
  }
  return outlines;
}

/// The part of a convex polygon where side * x[axis] <= side * limit.
std::vector<Vector3d> clipped(const std::vector<Vector3d>& polygon, int axis, double side, double limit) {
  std::vector<Vector3d> result;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Vector3d &from = polygon[i], &to = polygon[(i + 1) % polygon.size()];
    const double a = side * (from[axis] - limit), b = side * (to[axis] - limit);
    if (a <= 0) result.push_back(from);
    if ((a < 0 && b > 0) || (a > 0 && b < 0)) result.push_back(from + a / (a - b) * (to - from));
  }
  return result;
}

bool reaches_into(const TriangleSurface& surface, std::size_t t, const Eigen::AlignedBox3d& box) {
  const auto corner = surface.corners(t);
  std::vector<Vector3d> polygon(corner.begin(), corner.end());
  for (int axis = 0; axis < 3; ++axis) {
    polygon = clipped(polygon, axis, 1, box.max()[axis]);
    polygon = clipped(polygon, axis, -1, box.min()[axis]);
  }
  return !polygon.empty();
}

/// Twice the area within an outline, seen from beyond the plane: negative for a hole's.
double signed_area(const TriangleSurface& surface, const PlateBox& plate, const std::vector<int>& outline) {
  const int u = (plate.axis + 1) % 3, v = (plate.axis + 2) % 3;
  double area = 0;
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const Vector3d &a = surface.point_mm[outline[i]], &b = surface.point_mm[outline[(i + 1) % outline.size()]];
    area += plate.side * (a[u] * b[v] - b[u] * a[v]);
  }
  return area;
}

/// A point in a hole: beside the middle of an edge, to the right.
Vector3d hole_point_mm(const TriangleSurface& surface, const PlateBox& plate, const std::vector<int>& outline) {
  constexpr double kShareOfEdge = 1e-3;
  const Vector3d &a = surface.point_mm[outline[0]], &b = surface.point_mm[outline[1]];
  const Vector3d beyond = plate.side * Vector3d::Unit(plate.axis);
  return (a + b) / 2 + kShareOfEdge * (b - a).cross(beyond);
}

}  // namespace

void snap_to_box(TriangleSurface& surface, const Eigen::AlignedBox3d& box_mm) {
  for (Vector3d& at : surface.point_mm) {
    for (int axis = 0; axis < 3; ++axis) {
      for (const double plane_mm : {box_mm.min()[axis], box_mm.max()[axis]}) {
        if (std::abs(at[axis] - plane_mm) < kSnapMm) at[axis] = plane_mm;
      }
    }
  }
}

Facet cut_at_joined_face(TriangleSurface& surface, const PlateBox& plate, const std::string& file,
                         const std::string& field) {
  const std::string face = "the box's " + face_name(plate) + " face";
  Cutter cutter(surface, plate);
  const std::size_t count = surface.triangle.size();
  for (std::size_t t = 0; t < count; ++t) {
    if (cutter.cut(t)) continue;
    throw InputError(file, field,
                     "a finger that reaches beyond the edges of " + face + " around " + place_text(surface.middle(t)),
                     "a box around the plate alone");
  }
  Facet facet;
  facet.outlines = cutter.outlines();
  if (facet.outlines.empty()) {
    throw InputError(file, field, "no part of the finger that crosses " + face,
                     "the plate in the box, joined to the finger there; the finger reaches " + reach_text(surface) +
                         ", if its units are right");
  }
  for (const auto& outline : facet.outlines) {
    if (signed_area(surface, plate, outline) < 0) facet.holes_mm.push_back(hole_point_mm(surface, plate, outline));
  }
  return facet;
}

std::vector<std::size_t> plate_triangles(const TriangleSurface& surface, const PlateBox& plate, const std::string& file,
                                         const std::string& field) {
  const double plane_mm = (plate.side > 0 ? plate.box_mm.max() : plate.box_mm.min())[plate.axis];
  const Eigen::AlignedBox3d inner(plate.box_mm.min().array() + kSnapMm / 2, plate.box_mm.max().array() - kSnapMm / 2);
  std::vector<std::size_t> result;
  for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
    const auto corner = surface.corners(t);
    const bool within =
        std::all_of(corner.begin(), corner.end(), [&](const Vector3d& at) { return plate.box_mm.contains(at); });
    const bool on_joined_face =
        std::all_of(corner.begin(), corner.end(), [&](const Vector3d& at) { return at[plate.axis] == plane_mm; });
    // What lies in the joined face and faces into the box belongs to the finger, which continues there.
    if (within && !(on_joined_face && plate.side * surface.twice_area(t)[plate.axis] < 0)) {
      result.push_back(t);
    } else if (reaches_into(surface, t, inner)) {
      throw InputError(file, field,
                       "a finger that passes through a side of the box around " + place_text(surface.middle(t)),
                       "a plate that hangs free in its box but for the " + face_name(plate) + " face");
    }
  }
  if (result.empty()) throw InputError(file, field, "nothing of the finger in it", "the plate");
  return result;
}

}  // namespace finsight::host
