// Half-edge collapses: a point is moved onto a neighbour and is gone, with the two triangles at their edge. What is
// left are points of the original surface. The error of a collapse is how far the point is from the triangles that take
// its place, or those, where they are furthest off, from the triangles before. Points remember the largest error near
// them, so that collapses do not add up to more than is allowed.
#include <algorithm>
#include <array>
#include <limits>
#include <queue>
#include <set>
#include <tuple>

#include "hostgen/finger/triangle_surface.h"

namespace finsight::host {

namespace {

using Eigen::Vector3d;

/// Ericson, "Real-Time Collision Detection", 2005, section 5.1.5.
double distance_to_triangle(const Vector3d& p, const Vector3d& a, const Vector3d& b, const Vector3d& c) {
  const Vector3d ab = b - a, ac = c - a, ap = p - a, bp = p - b, cp = p - c;
  const double d1 = ab.dot(ap), d2 = ac.dot(ap), d3 = ab.dot(bp), d4 = ac.dot(bp), d5 = ab.dot(cp), d6 = ac.dot(cp);
  if (d1 <= 0 && d2 <= 0) return ap.norm();
  if (d3 >= 0 && d4 <= d3) return bp.norm();
  if (d6 >= 0 && d5 <= d6) return cp.norm();
  const double vc = d1 * d4 - d3 * d2, vb = d5 * d2 - d1 * d6, va = d3 * d6 - d5 * d4;
  if (vc <= 0 && d1 >= 0 && d3 <= 0) return (ap - d1 / (d1 - d3) * ab).norm();
  if (vb <= 0 && d2 >= 0 && d6 <= 0) return (ap - d2 / (d2 - d6) * ac).norm();
  if (va <= 0 && d4 - d3 >= 0 && d5 - d6 >= 0) return (bp - (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (c - b)).norm();
  const Vector3d normal = ab.cross(ac);
  return std::abs(normal.dot(ap)) / normal.norm();
}

using Fan = std::vector<std::array<Vector3d, 3>>;

double distance_to_fan(const Vector3d& p, const Fan& fan) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const auto& [a, b, c] : fan) nearest = std::min(nearest, distance_to_triangle(p, a, b, c));
  return nearest;
}

/// How far the triangles of a fan are from another, at their middles and along their edges.
double furthest(const Fan& fan, const Fan& from) {
  double most = 0;
  for (const auto& corner : fan) {
    most = std::max(most, distance_to_fan((corner[0] + corner[1] + corner[2]) / 3, from));
    for (std::size_t i = 0; i < 3; ++i) {
      for (const double share : {0.1, 0.5, 0.9}) {
        const Vector3d along = corner[i] + share * (corner[(i + 1) % 3] - corner[i]);
        most = std::max(most, distance_to_fan(along, from));
      }
    }
  }
  return most;
}

class Collapser {
 public:
  explicit Collapser(TriangleSurface& surface)
      : surface_(surface), around_(surface.point_mm.size()), error_mm_(around_.size()) {
    for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
      for (const int point : surface.triangle[t]) around_[static_cast<std::size_t>(point)].insert(t);
    }
    removed_.resize(surface.triangle.size());
  }
  void run(double tolerance_mm);
  void finish();

 private:
  struct Candidate {
    double length_mm = 0;
    int from = 0, to = 0;
    bool operator<(const Candidate& other) const {  // the shortest first; the rest so that it is always the same
      return std::tie(length_mm, from, to) > std::tie(other.length_mm, other.from, other.to);
    }
  };
  const Vector3d& at(int point) const { return surface_.point_mm[static_cast<std::size_t>(point)]; }
  std::set<int> neighbours(int point) const;
  void offer(int point);
  bool collapse(int from, int to);

  TriangleSurface& surface_;
  double tolerance_mm_ = 0;
  std::vector<std::set<std::size_t>> around_;  // triangles of a point
  std::vector<double> error_mm_;
  std::vector<bool> removed_;  // triangles
  std::priority_queue<Candidate> queue_;
};

std::set<int> Collapser::neighbours(int point) const {
  std::set<int> all;
  for (const std::size_t t : around_[static_cast<std::size_t>(point)]) {
    all.insert(surface_.triangle[t].begin(), surface_.triangle[t].end());
  }
  all.erase(point);
  return all;
}

void Collapser::offer(int point) {
  for (const int other : neighbours(point)) {
    const double length_mm = (at(point) - at(other)).norm();
    queue_.push({length_mm, point, other});
    queue_.push({length_mm, other, point});
  }
}

bool Collapser::collapse(int from, int to) {
  constexpr double kTurned = 0.9;  // cosine: no triangle turns by more, or the surface would fold
  auto& fan = around_[static_cast<std::size_t>(from)];
  const std::set<int> ring = neighbours(from), others = neighbours(to);
  if (!ring.contains(to)) return false;
  // The link condition: else the surface would be pinched.
  if (std::ranges::count_if(ring, [&](int point) { return others.contains(point); }) != 2) return false;

  std::vector<std::size_t> gone, moved;
  for (const std::size_t t : fan) {
    const auto& corner = surface_.triangle[t];
    (std::ranges::find(corner, to) != corner.end() ? gone : moved).push_back(t);
  }
  if (gone.size() != 2 || moved.empty()) return false;
  Fan before_fan, after_fan;
  for (const std::size_t t : fan) before_fan.push_back(surface_.corners(t));
  for (const std::size_t t : moved) {
    std::array<Vector3d, 3> corner = surface_.corners(t);
    const Vector3d before = (corner[1] - corner[0]).cross(corner[2] - corner[0]);
    for (std::size_t i = 0; i < 3; ++i) {
      if (surface_.triangle[t][i] == from) corner[i] = at(to);
    }
    const Vector3d after = (corner[1] - corner[0]).cross(corner[2] - corner[0]);
    const double longest = std::max({(corner[1] - corner[0]).squaredNorm(), (corner[2] - corner[1]).squaredNorm(),
                                     (corner[0] - corner[2]).squaredNorm()});
    if (after.norm() < 1e-6 * longest || before.dot(after) < kTurned * before.norm() * after.norm()) return false;
    after_fan.push_back(corner);
  }
  const double error_mm = error_mm_[static_cast<std::size_t>(from)] +
                          std::max(distance_to_fan(at(from), after_fan), furthest(after_fan, before_fan));
  if (error_mm > tolerance_mm_) return false;

  for (const std::size_t t : gone) {
    removed_[t] = true;
    for (const int point : surface_.triangle[t]) around_[static_cast<std::size_t>(point)].erase(t);
  }
  for (const std::size_t t : moved) {
    std::ranges::replace(surface_.triangle[t], from, to);
    around_[static_cast<std::size_t>(to)].insert(t);
  }
  fan.clear();
  for (const int point : ring) {
    double& error = error_mm_[static_cast<std::size_t>(point)];
    error = std::max(error, error_mm);
  }
  return true;
}

void Collapser::run(double tolerance_mm) {
  tolerance_mm_ = tolerance_mm;
  for (std::size_t point = 0; point < around_.size(); ++point) offer(static_cast<int>(point));
  while (!queue_.empty()) {
    const Candidate next = queue_.top();
    queue_.pop();
    if (around_[static_cast<std::size_t>(next.from)].empty() || around_[static_cast<std::size_t>(next.to)].empty())
      continue;
    if (collapse(next.from, next.to)) offer(next.to);
  }
}

/// Numbers what is left. Labels keep their points that are left.
void Collapser::finish() {
  std::vector<int> number(around_.size(), -1);
  std::vector<Vector3d> points;
  for (std::size_t point = 0; point < around_.size(); ++point) {
    if (around_[point].empty()) continue;
    number[point] = static_cast<int>(points.size());
    points.push_back(surface_.point_mm[point]);
  }
  std::vector<std::array<int, 3>> triangles;
  for (std::size_t t = 0; t < removed_.size(); ++t) {
    if (removed_[t]) continue;
    auto corner = surface_.triangle[t];
    for (int& point : corner) point = number[static_cast<std::size_t>(point)];
    triangles.push_back(corner);
  }
  for (auto& [name, labelled] : surface_.labelled) {
    std::vector<int> kept;
    for (const int point : labelled) {
      if (number[static_cast<std::size_t>(point)] >= 0) kept.push_back(number[static_cast<std::size_t>(point)]);
    }
    labelled = std::move(kept);
  }
  surface_.point_mm = std::move(points);
  surface_.triangle = std::move(triangles);
}

}  // namespace

void simplify(TriangleSurface& surface, double tolerance_mm) {
  Collapser collapser(surface);
  collapser.run(0.01 * tolerance_mm);  // first what costs nothing: points along edges and in planes
  collapser.run(tolerance_mm);
  collapser.finish();
}

}  // namespace finsight::host
