#include "hostgen/finger/front_face.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

namespace finsight::host {

namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kFrontCosine = 0.5;
constexpr double kInBoxMm = 1e-6;

/// Barycentric coordinates of (x, y) in the triangle seen along z.
Vector3d barycentric(const std::array<Vector3d, 3>& corner, double x, double y) {
  const Vector2d p(x, y), a = corner[0].head<2>(), ab = corner[1].head<2>() - a, ac = corner[2].head<2>() - a;
  const double twice_area = ab.x() * ac.y() - ab.y() * ac.x();
  const Vector2d ap = p - a;
  const double b = (ap.x() * ac.y() - ap.y() * ac.x()) / twice_area;
  const double c = (ab.x() * ap.y() - ab.y() * ap.x()) / twice_area;
  return {1 - b - c, b, c};
}

}  // namespace

bool faces_front(const Vector3d& outward) { return -outward.z() > kFrontCosine * outward.norm(); }

std::vector<std::size_t> front_patch(std::span<const Vector3d> points, std::span<const std::array<int, 3>> triangles,
                                     const Eigen::AlignedBox3d& box) {
  const Eigen::AlignedBox3d wide(box.min().array() - kInBoxMm, box.max().array() + kInBoxMm);
  std::vector<double> area(triangles.size());
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    const auto& [a, b, c] = triangles[t];
    const Vector3d outward = (points[b] - points[a]).cross(points[c] - points[a]);
    const bool inside = wide.contains(points[a]) && wide.contains(points[b]) && wide.contains(points[c]);
    if (inside && faces_front(outward)) area[t] = -outward.z();
  }
  return largest_patch(triangles, std::move(area));
}

std::vector<std::size_t> largest_patch(std::span<const std::array<int, 3>> triangles, std::vector<double> area) {
  std::multimap<std::pair<int, int>, std::size_t> at_edge;
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    if (!(area[t] > 0)) continue;
    const auto& [a, b, c] = triangles[t];
    for (const auto& [from, to] : {std::minmax(a, b), std::minmax(b, c), std::minmax(c, a)})
      at_edge.insert({{from, to}, t});
  }
  std::vector<std::size_t> best;
  double best_area = 0;
  for (std::size_t first = 0; first < triangles.size(); ++first) {
    if (!(area[first] > 0)) continue;
    std::vector<std::size_t> patch = {first};
    double sum = area[first];
    area[first] = 0;                                  // taken
    for (std::size_t i = 0; i < patch.size(); ++i) {  // grows during the loop
      const auto& [a, b, c] = triangles[patch[i]];
      for (const auto& [from, to] : {std::minmax(a, b), std::minmax(b, c), std::minmax(c, a)}) {
        const auto [begin, end] = at_edge.equal_range({from, to});
        for (auto other = begin; other != end; ++other) {
          if (!(area[other->second] > 0)) continue;
          sum += area[other->second];
          area[other->second] = 0;
          patch.push_back(other->second);
        }
      }
    }
    if (sum > best_area) {
      best_area = sum;
      best = std::move(patch);
    }
  }
  std::sort(best.begin(), best.end());
  return best;
}

Vector3d nearest_in_triangle(const std::array<Vector3d, 3>& corner, double x, double y) {
  const Vector3d inside = barycentric(corner, x, y);
  if (inside.minCoeff() >= 0) return inside;
  Vector3d best = Vector3d::Zero();
  double best_distance = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    const auto from = corner[static_cast<std::size_t>(i)].head<2>(), to = corner[static_cast<std::size_t>(j)].head<2>();
    const Vector2d edge = to - from;
    const double along = std::clamp((Vector2d(x, y) - from).dot(edge) / edge.squaredNorm(), 0.0, 1.0);
    const double distance = (from + along * edge - Vector2d(x, y)).squaredNorm();
    if (distance >= best_distance) continue;
    best_distance = distance;
    best.setZero();
    best[i] = 1 - along;
    best[j] = along;
  }
  return best;
}

}  // namespace finsight::host
