// Cuts triangles that reach out of the front's box along the box's planes, one plane after the other. Points are put on
// edges, so that a triangle and its neighbour are split at the same place.
#include <algorithm>
#include <map>

#include "hostgen/finger/front_face.h"
#include "hostgen/finger/plate_cut.h"

namespace finsight::host {

namespace {

using Eigen::Vector3d;
using Polygon = std::vector<Vector3d>;

struct Plane {
  int axis = 0, side = 1;  ///< of the box: its lower (-1) or upper (1) plane
  double at_mm = 0;
  double beyond_mm(const Vector3d& point) const { return side * (point[axis] - at_mm); }
};

std::vector<Plane> planes_of(const Eigen::AlignedBox3d& box) {
  std::vector<Plane> planes;
  for (int axis = 0; axis < 3; ++axis) {
    planes.push_back({axis, -1, box.min()[axis]});
    planes.push_back({axis, 1, box.max()[axis]});
  }
  return planes;
}

/// Sutherland and Hodgman.
Polygon clipped(Polygon polygon, const std::vector<Plane>& planes) {
  for (const Plane& plane : planes) {
    Polygon kept;
    for (std::size_t i = 0; i < polygon.size(); ++i) {
      const Vector3d &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
      const double da = plane.beyond_mm(a), db = plane.beyond_mm(b);
      if (da <= 0) kept.push_back(a);
      if ((da < 0 && db > 0) || (da > 0 && db < 0)) kept.push_back(a + da / (da - db) * (b - a));
    }
    polygon = std::move(kept);
  }
  return polygon;
}

double area_mm2(const Polygon& polygon) {
  Vector3d twice = Vector3d::Zero();
  for (std::size_t i = 2; i < polygon.size(); ++i) {
    twice += (polygon[i - 1] - polygon[0]).cross(polygon[i] - polygon[0]);
  }
  return 0.5 * twice.norm();
}

/// Triangles of the touched face, those that reach out of the box among them.
std::vector<bool> in_front(const TriangleSurface& surface, const std::vector<Plane>& planes) {
  constexpr double kSmallest_mm2 = 1e-3;
  std::vector<double> area(surface.triangle.size());
  for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
    const auto corners = surface.corners(t);
    if (!faces_front(surface.twice_area(t))) continue;
    const double part_mm2 = area_mm2(clipped({corners.begin(), corners.end()}, planes));
    if (part_mm2 > kSmallest_mm2) area[t] = part_mm2;
  }
  std::vector<bool> front(surface.triangle.size());
  for (const std::size_t t : largest_patch(surface.triangle, std::move(area))) front[t] = true;
  return front;
}

/// The new points on edges, by the edges' ends.
using Middles = std::map<std::pair<int, int>, int>;

int middle_of(const Middles& middles, int a, int b) {
  const auto found = middles.find(std::minmax(a, b));
  return found == middles.end() ? -1 : found->second;
}

/// A triangle whose edges have new points, as triangles without.
std::vector<std::array<int, 3>> split(std::array<int, 3> corner, const Middles& middles) {
  std::array<int, 3> m{};
  int count = 0;
  const auto look = [&] {
    count = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      m[i] = middle_of(middles, corner[i], corner[(i + 1) % 3]);
      count += m[i] >= 0;
    }
  };
  look();
  // One: on the first edge. Two: on the first and the last.
  while ((count == 1 && m[0] < 0) || (count == 2 && m[1] >= 0)) {
    std::rotate(corner.begin(), corner.begin() + 1, corner.end());
    look();
  }
  const auto [a, b, c] = corner;
  switch (count) {
    case 0:
      return {corner};
    case 1:
      return {{a, m[0], c}, {m[0], b, c}};
    case 2:
      return {{a, m[0], m[2]}, {m[0], b, c}, {m[0], c, m[2]}};
    default:
      return {{a, m[0], m[2]}, {m[0], b, m[1]}, {m[2], m[1], c}, {m[0], m[1], m[2]}};
  }
}

}  // namespace

void cut_front_at_box(TriangleSurface& surface, const Eigen::AlignedBox3d& box) {
  snap_to_box(surface, box);
  const std::vector<Plane> planes = planes_of(box);
  for (const Plane& plane : planes) {
    Middles middles;
    const std::vector<bool> front = in_front(surface, planes);
    for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
      if (!front[t]) continue;
      for (std::size_t i = 0; i < 3; ++i) {
        const auto [low, high] = std::minmax(surface.triangle[t][i], surface.triangle[t][(i + 1) % 3]);
        const Vector3d a = surface.point_mm[static_cast<std::size_t>(low)];
        const Vector3d b = surface.point_mm[static_cast<std::size_t>(high)];
        const double da = plane.beyond_mm(a), db = plane.beyond_mm(b);
        if (!(da * db < 0)) continue;
        const auto [place, added] = middles.try_emplace({low, high}, static_cast<int>(surface.point_mm.size()));
        if (!added) continue;
        Vector3d middle = a + da / (da - db) * (b - a);
        middle[plane.axis] = plane.at_mm;
        surface.point_mm.push_back(middle);
      }
    }
    std::vector<std::array<int, 3>> triangles;
    for (const auto& corner : surface.triangle) {
      const auto parts = split(corner, middles);
      triangles.insert(triangles.end(), parts.begin(), parts.end());
    }
    surface.triangle = std::move(triangles);
  }
}

}  // namespace finsight::host
