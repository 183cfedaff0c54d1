// The finger's mesh with ten-node (quadratic) tetrahedra, and point loads on its touched face.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

#include "hostgen/finger/mesh.h"

namespace finsight::host {

/// Nodes per quadratic tetrahedron: 4 corners, then the middles of edges 01 12 02 03 13 23 (CalculiX's C3D10).
inline constexpr int kTetNodes = 10;
inline constexpr std::array<std::array<int, 2>, 6> kTetEdges{{{0, 1}, {1, 2}, {0, 2}, {0, 3}, {1, 3}, {2, 3}}};
/// Gauss points per tetrahedron; each stands for a quarter of its volume and integrates quadratic terms exactly.
inline constexpr int kGaussPoints = 4;
/// Where a tetrahedron is evaluated: at the Gauss points, then in its middle.
inline constexpr int kPoints = kGaussPoints + 1;
inline constexpr int kMiddle = kGaussPoints;

/// All truth is made with the selective element: C3D10 that resists changes of volume mostly by what they are in its
/// middle. Rubber hardly changes its volume, and where every Gauss point insists on that, coarse meshes are too stiff
/// (volumetric locking; selective reduced integration: Hughes, The Finite Element Method, 1987, section 4.5).
/// The others are for comparison: C3D10 is CalculiX's. C3D4, four nodes and one constant strain, is kept in the same
/// arrays, its middle nodes fixed and without influence.
enum class Element { kC3D4, kC3D10, kSelective };

/// From where something pushes: onto the touched face (along z), or elsewhere.
enum class Side { kFront, kLeft, kRight, kBack, kTip };
inline constexpr std::size_t kSides = 5;

/// A triangle as it looks from one side, in that side's axes: what side_point() searches through, thousands of times
/// for every patch.
struct SideTriangle {
  std::array<int, 6> node;  ///< corners, middles of 01 12 20
  std::array<Eigen::Vector3d, 3> corner_mm;
  Eigen::Array2d low_mm, high_mm;  ///< of its bounding box
  Eigen::Vector3d inward;          ///< unit normal
};

/// The same geometry as the TetMesh it is made of (edges stay straight); only the elements are richer.
struct QuadraticMesh {
  Element element = Element::kSelective;
  std::size_t corner_nodes = 0;  ///< the first nodes, numbered as in the TetMesh
  std::vector<Eigen::Vector3d> node_mm;
  std::vector<std::array<int, kTetNodes>> tets;  ///< in the order of the TetMesh
  std::vector<int> region;                       ///< per tet, as in the TetMesh
  std::vector<std::uint8_t> fixed;               ///< per node: 1 on the base, and middle nodes of C3D4
  std::array<std::vector<int>, kPlates> plate_nodes;
  std::vector<std::array<int, 6>> front;  ///< triangles of the touched face: corners, middles of 01 12 20
  std::vector<std::array<int, 6>> skin;   ///< the same of all that is outside, counter-clockwise seen from there
  /// Of each Side: on the front those of `front`, elsewhere those of `skin` that a push from there would not only
  /// graze.
  std::array<std::vector<SideTriangle>, kSides> sides;
};

QuadraticMesh make_quadratic(const TetMesh& mesh, Element element = Element::kSelective);

/// Gradients of the ten shape functions (1/mm, undeformed coordinates) at the points of a straight-edged tet.
struct TetGradients {
  std::array<std::array<Eigen::Vector3d, kTetNodes>, kPoints> at;
  double volume_mm3 = 0;
};
TetGradients tet_gradients(const std::array<Eigen::Vector3d, 4>& corner_mm, Element element = Element::kSelective);

/// A point of the outside, mostly of the touched face, as a weighted sum of the six nodes of the quadratic triangle
/// that holds it. A force at the point is shared among the nodes by the same weights (the work-equivalent load), and
/// they interpolate displacements at it. The weights sum to 1; away from the corners the weights of corners are
/// negative (down to -1/8), which is right: force and moment of the six add up to those of the one.
struct FacePoint {
  std::array<int, 6> node{};
  std::array<double, 6> weight{};
  Eigen::Vector3d at_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d inward = Eigen::Vector3d::Zero();  ///< unit normal of the undeformed face into the finger
};
/// Axes of a side: columns are the two in which places on it are told, and the direction in which it is pushed. Places
/// on the front and the back are x and y, on the left and right z and y, on the tip x and z.
Eigen::Matrix3d side_axes(Side side);
/// The point that something pushed onto this side at this place meets first; beside the finger, the nearest one.
FacePoint side_point(const QuadraticMesh& mesh, Side side, const Eigen::Vector2d& place_mm);

}  // namespace finsight::host
