#include "hostgen/fem/quadratic_mesh.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <limits>
#include <map>

#include "hostgen/finger/front_face.h"

namespace finsight::host {
namespace {

/// Gives every edge one middle node, numbered in the order in which the edges are first met.
class MiddleNodes {
 public:
  MiddleNodes(const TetMesh& mesh, QuadraticMesh& out) : out_(out), on_base_(mesh.node_mm.size(), false) {
    for (const int node : mesh.base_nodes) on_base_[static_cast<std::size_t>(node)] = true;
  }

  int between(int a, int b) {
    const auto [edge, added] = middle_.try_emplace(std::minmax(a, b), static_cast<int>(out_.node_mm.size()));
    if (added) {
      const auto from = static_cast<std::size_t>(a), to = static_cast<std::size_t>(b);
      out_.node_mm.push_back(0.5 * (out_.node_mm[from] + out_.node_mm[to]));
      // The base is a plane or a box, so an edge between two of its nodes lies in it.
      out_.fixed.push_back(on_base_[from] && on_base_[to]);
    }
    return edge->second;
  }

 private:
  QuadraticMesh& out_;
  std::vector<bool> on_base_;
  std::map<std::pair<int, int>, int> middle_;
};

std::vector<SideTriangle> triangles_of(const QuadraticMesh& mesh, Side side) {
  constexpr double kSteepest = 0.5;  // of a wall that is still that side's: cosine to the direction of pushing
  const Eigen::Matrix3d axes = side_axes(side);
  std::vector<SideTriangle> triangles;
  for (const auto& nodes : side == Side::kFront ? mesh.front : mesh.skin) {
    SideTriangle triangle;
    triangle.node = nodes;
    auto& corner = triangle.corner_mm;
    for (std::size_t i = 0; i < 3; ++i) {
      corner[i] = axes.transpose() * mesh.node_mm[static_cast<std::size_t>(nodes[i])];
    }
    triangle.low_mm = corner[0].cwiseMin(corner[1]).cwiseMin(corner[2]).head<2>();
    triangle.high_mm = corner[0].cwiseMax(corner[1]).cwiseMax(corner[2]).head<2>();
    Eigen::Vector3d inward = (corner[1] - corner[0]).cross(corner[2] - corner[0]).normalized();
    if (side == Side::kFront && inward.z() < 0) inward = -inward;
    if (side != Side::kFront) inward = (axes.determinant() > 0 ? -1 : 1) * inward;  // a mirror turns the winding
    if (side != Side::kFront && inward.z() < kSteepest) continue;
    triangle.inward = inward;
    triangles.push_back(triangle);
  }
  return triangles;
}

}  // namespace

QuadraticMesh make_quadratic(const TetMesh& mesh, Element element) {
  QuadraticMesh out;
  out.element = element;
  out.corner_nodes = mesh.node_mm.size();
  for (const auto& node : mesh.node_mm) out.node_mm.emplace_back(node[0], node[1], node[2]);
  out.fixed.assign(out.corner_nodes, 0);
  for (const int node : mesh.base_nodes) out.fixed[static_cast<std::size_t>(node)] = 1;
  out.region = mesh.region;

  MiddleNodes middles(mesh, out);
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    std::array<int, kTetNodes> nodes;
    std::copy_n(mesh.tets[t].begin(), 4, nodes.begin());
    for (std::size_t e = 0; e < kTetEdges.size(); ++e) {
      const auto [a, b] = kTetEdges[e];
      nodes[4 + e] = middles.between(nodes[static_cast<std::size_t>(a)], nodes[static_cast<std::size_t>(b)]);
    }
    out.tets.push_back(nodes);
    if (mesh.region[t] >= kFirstPlateRegion) {
      auto& plate = out.plate_nodes[static_cast<std::size_t>(mesh.region[t] - kFirstPlateRegion)];
      plate.insert(plate.end(), nodes.begin(), element == Element::kC3D4 ? nodes.begin() + 4 : nodes.end());
    }
  }
  if (element == Element::kC3D4) {
    std::fill(out.fixed.begin() + static_cast<std::ptrdiff_t>(out.corner_nodes), out.fixed.end(), 1);
  }
  for (auto& plate : out.plate_nodes) {
    std::sort(plate.begin(), plate.end());
    plate.erase(std::unique(plate.begin(), plate.end()), plate.end());
  }
  for (const auto& [a, b, c] : front_triangles(mesh)) {
    out.front.push_back({a, b, c, middles.between(a, b), middles.between(b, c), middles.between(c, a)});
  }
  for (const auto& [a, b, c] : boundary_triangles(mesh)) {
    out.skin.push_back({a, b, c, middles.between(a, b), middles.between(b, c), middles.between(c, a)});
  }
  for (std::size_t side = 0; side < kSides; ++side) out.sides[side] = triangles_of(out, static_cast<Side>(side));
  return out;
}

TetGradients tet_gradients(const std::array<Eigen::Vector3d, 4>& corner_mm, Element element) {
  Eigen::Matrix3d edges;
  for (int i = 0; i < 3; ++i) edges.col(i) = corner_mm[static_cast<std::size_t>(i) + 1] - corner_mm[0];
  TetGradients out;
  out.volume_mm3 = edges.determinant() / 6;

  // Gradients of the barycentric coordinates L are constant; those of the shape functions L(2L - 1) and 4 L L' follow.
  const Eigen::Matrix3d inverse = edges.inverse();
  std::array<Eigen::Vector3d, 4> dL;
  for (std::size_t i = 0; i < 3; ++i) dL[i + 1] = inverse.row(static_cast<int>(i)).transpose();
  dL[0] = -(dL[1] + dL[2] + dL[3]);
  if (element == Element::kC3D4) {
    for (auto& at : out.at) {
      at.fill(Eigen::Vector3d::Zero());
      std::copy(dL.begin(), dL.end(), at.begin());
    }
    return out;
  }
  constexpr double kNear = 0.58541019662496845, kFar = 0.13819660112501052;  // (5 + 3 sqrt 5) / 20, (5 - sqrt 5) / 20
  for (std::size_t g = 0; g < kPoints; ++g) {
    std::array<double, 4> L{kFar, kFar, kFar, kFar};
    if (g == kMiddle) {
      L.fill(0.25);
    } else {
      L[g] = kNear;
    }
    for (std::size_t a = 0; a < 4; ++a) out.at[g][a] = (4 * L[a] - 1) * dL[a];
    for (std::size_t e = 0; e < kTetEdges.size(); ++e) {
      const auto a = static_cast<std::size_t>(kTetEdges[e][0]), b = static_cast<std::size_t>(kTetEdges[e][1]);
      out.at[g][4 + e] = 4 * (L[a] * dL[b] + L[b] * dL[a]);
    }
  }
  return out;
}

Eigen::Matrix3d side_axes(Side side) {
  using V = Eigen::Vector3d;
  Eigen::Matrix3d axes;
  switch (side) {
    case Side::kFront:
      axes << V::UnitX(), V::UnitY(), V::UnitZ();
      break;
    case Side::kLeft:
      axes << V::UnitZ(), V::UnitY(), V::UnitX();
      break;
    case Side::kRight:
      axes << V::UnitZ(), V::UnitY(), -V::UnitX();
      break;
    case Side::kBack:
      axes << V::UnitX(), V::UnitY(), -V::UnitZ();
      break;
    case Side::kTip:
      axes << V::UnitX(), V::UnitZ(), -V::UnitY();
      break;
  }
  return axes;
}

FacePoint side_point(const QuadraticMesh& mesh, Side side, const Eigen::Vector2d& place_mm) {
  constexpr double kSame_mm2 = 1e-12;  // of two places, that differ by less, the first on the way is meant
  const Eigen::Matrix3d axes = side_axes(side);
  double best_distance = std::numeric_limits<double>::infinity(), best_depth = best_distance;
  FacePoint best;
  for (const SideTriangle& triangle : mesh.sides[static_cast<std::size_t>(side)]) {
    // Most triangles' bounding boxes are already further away.
    const Eigen::Array2d asked = place_mm.array(), nearest = asked.max(triangle.low_mm).min(triangle.high_mm);
    if ((nearest - asked).matrix().squaredNorm() > best_distance + kSame_mm2) continue;
    const Eigen::Vector3d L = nearest_in_triangle(triangle.corner_mm, place_mm.x(), place_mm.y());
    const Eigen::Vector3d at = point_at(triangle.corner_mm, L);
    const double distance = (at.head<2>() - place_mm).squaredNorm();
    const bool is_nearer = distance < best_distance - kSame_mm2;
    if (!is_nearer && (distance > best_distance + kSame_mm2 || at.z() >= best_depth)) continue;
    best_distance = distance;
    best_depth = at.z();
    best.node = triangle.node;
    best.weight = {L[0] * (2 * L[0] - 1), L[1] * (2 * L[1] - 1), L[2] * (2 * L[2] - 1),
                   4 * L[0] * L[1],       4 * L[1] * L[2],       4 * L[2] * L[0]};
    if (mesh.element == Element::kC3D4) best.weight = {L[0], L[1], L[2], 0, 0, 0};
    best.at_mm = axes * at;
    best.inward = axes * triangle.inward;
  }
  return best;
}

}  // namespace finsight::host
