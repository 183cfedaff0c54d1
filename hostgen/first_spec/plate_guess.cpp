#include "hostgen/first_spec/plate_guess.h"

#include <algorithm>
#include <array>
#include <limits>
#include <map>

#include "firmware/input_error.h"
#include "firmware/types.h"
#include "hostgen/finger/front_face.h"
#include "hostgen/finger/plate_cut.h"

namespace finsight::host {

namespace {

using Eigen::AlignedBox3d;
using Eigen::Vector3d;

/// Edge-connected level triangles of one height that look down.
std::vector<std::vector<std::size_t>> undersides(const TriangleSurface& surface) {
  constexpr double kLevel = 0.99, kSameHeight_mm = 0.05;
  std::vector<double> area(surface.triangle.size());
  for (std::size_t t = 0; t < area.size(); ++t) {
    const Vector3d twice = surface.twice_area(t);
    if (-twice.y() > kLevel * twice.norm()) area[t] = twice.norm();
  }
  std::vector<std::vector<std::size_t>> groups;
  while (true) {
    const std::vector<std::size_t> patch = largest_patch(surface.triangle, area);
    if (patch.empty()) return groups;
    std::vector<std::size_t> group;
    for (const std::size_t t : patch) {
      area[t] = 0;
      if (std::abs(surface.middle(t).y() - surface.middle(patch[0]).y()) < kSameHeight_mm) group.push_back(t);
    }
    groups.push_back(group);
  }
}

/// How far straight up from the underside's rim its sides go: the plate's thickness.
double side_height_mm(const TriangleSurface& surface, const std::vector<std::size_t>& patch) {
  std::map<std::pair<int, int>, int> rim;
  for (const std::size_t t : patch) {
    const auto& [a, b, c] = surface.triangle[t];
    for (const auto& [from, to] : {std::minmax(a, b), std::minmax(b, c), std::minmax(c, a)}) ++rim[{from, to}];
  }
  const double y_mm = surface.middle(patch[0]).y();
  double height = std::numeric_limits<double>::infinity();
  for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
    const auto& [a, b, c] = surface.triangle[t];
    const bool beside =
        std::ranges::any_of(std::array{std::minmax(a, b), std::minmax(b, c), std::minmax(c, a)}, [&](const auto& edge) {
          const auto found = rim.find({edge.first, edge.second});
          return found != rim.end() && found->second == 1;
        });
    if (!beside || std::ranges::find(patch, t) != patch.end()) continue;
    double top = 0;
    for (const Vector3d& corner : surface.corners(t)) top = std::max(top, corner.y() - y_mm);
    if (top > 0) height = std::min(height, top);
  }
  return height;
}

/// Moeller and Trumbore.
bool blocks(const std::array<Vector3d, 3>& corner, const Vector3d& from, const Vector3d& to) {
  const Vector3d ray = to - from, e1 = corner[1] - corner[0], e2 = corner[2] - corner[0], p = ray.cross(e2);
  const double determinant = e1.dot(p);
  if (determinant == 0) return false;
  const Vector3d s = from - corner[0], q = s.cross(e1);
  const double u = s.dot(p) / determinant, v = ray.dot(q) / determinant, share = e2.dot(q) / determinant;
  return u >= 0 && v >= 0 && u + v <= 1 && share > 1e-6 && share < 1 - 1e-3;
}

bool sees(const TriangleSurface& surface, const Vector3d& camera, const Vector3d& marker, double half_mm) {
  for (const double x : {-half_mm, 0.0, half_mm}) {
    for (const double z : {-half_mm, 0.0, half_mm}) {
      for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
        if (blocks(surface.corners(t), camera, marker + Vector3d(x, 0, z))) return false;
      }
    }
  }
  return true;
}

/// Whether the box cuts a plate off the surface.
bool cuts(TriangleSurface surface, const AlignedBox3d& box) {
  try {
    const PlateBox plate{box, 1, 1};
    snap_to_box(surface, box);
    cut_at_joined_face(surface, plate, "", "");
    plate_triangles(surface, plate, "", "");
    return true;
  } catch (const InputError&) {
    return false;
  }
}

std::vector<PlateGuess> guess_plates(const TriangleSurface& surface) {
  constexpr double kAboveBase_mm = 5, kRoom_mm = 0.3, kUsual_mm = 2, kSmallestMarker_mm = 4.5;
  AlignedBox3d bounds;
  for (const Vector3d& at : surface.point_mm) bounds.extend(at);
  const Vector3d camera(0, -kCameraBelow_mm, bounds.center().z());
  std::vector<PlateGuess> plates;
  for (const auto& patch : undersides(surface)) {
    AlignedBox3d rect;
    double area = 0;
    for (const std::size_t t : patch) {
      area += 0.5 * surface.twice_area(t).norm();
      for (const Vector3d& corner : surface.corners(t)) rect.extend(corner);
    }
    const Vector3d size = rect.sizes();
    PlateGuess guess;
    guess.marker_mm = rect.center();
    guess.room_mm = std::min(size.x(), size.z());
    if (rect.min().y() < bounds.min().y() + kAboveBase_mm || guess.room_mm * kMarkerShare < kSmallestMarker_mm)
      continue;
    if (area < 0.7 * size.x() * size.z()) continue;  // not a plate but a frame, or crooked
    for (const double thick : {side_height_mm(surface, patch), kUsual_mm}) {
      if (!(thick >= 0.5) || thick > 20) continue;
      guess.box_mm =
          AlignedBox3d(rect.min() - Vector3d(kRoom_mm, kRoom_mm, kRoom_mm),
                       Vector3d(rect.max().x() + kRoom_mm, rect.min().y() + thick, rect.max().z() + kRoom_mm));
      if (!cuts(surface, guess.box_mm)) continue;
      guess.visible = sees(surface, camera, guess.marker_mm - Vector3d(0, 0.01, 0), 0.4 * guess.room_mm);
      plates.push_back(guess);
      break;
    }
  }
  return plates;
}

}  // namespace

std::vector<PlateGuess> best_plates(const TriangleSurface& surface) {
  std::vector<PlateGuess> all = guess_plates(surface);
  const auto hidden = std::stable_partition(all.begin(), all.end(), [](const PlateGuess& p) { return p.visible; });
  if (hidden - all.begin() >= kPlates) all.erase(hidden, all.end());
  std::ranges::sort(all, [](const auto& a, const auto& b) { return a.marker_mm.y() > b.marker_mm.y(); });
  if (all.size() <= kPlates) return all;
  const double middle_mm = 0.5 * (all.front().marker_mm.y() + all.back().marker_mm.y());
  const auto middle = std::min_element(all.begin() + 1, all.end() - 1, [&](const auto& a, const auto& b) {
    return std::abs(a.marker_mm.y() - middle_mm) < std::abs(b.marker_mm.y() - middle_mm);
  });
  return {all.front(), *middle, all.back()};
}

}  // namespace finsight::host
