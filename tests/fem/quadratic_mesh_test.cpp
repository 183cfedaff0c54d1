#include "hostgen/fem/quadratic_mesh.h"

#include <doctest/doctest.h>

#include "tests/fem/box_mesh.h"

using namespace finsight::host;
using Eigen::Vector3d;
using finsight::test::box_mesh;
using finsight::test::small_finger_mesh;

namespace {

const Vector3d& node(const QuadraticMesh& mesh, int index) { return mesh.node_mm[static_cast<std::size_t>(index)]; }

/// A function that quadratic elements represent exactly, and its gradient.
double field(const Vector3d& x) {
  return 2 + x.x() - 3 * x.y() + 0.5 * x.x() * x.y() - 0.2 * x.z() * x.z() + x.y() * x.z();
}
Vector3d field_gradient(const Vector3d& x) { return {1 + 0.5 * x.y(), -3 + 0.5 * x.x() + x.z(), -0.4 * x.z() + x.y()}; }

}  // namespace

TEST_CASE("quadratic_mesh: every edge has one node in its middle") {
  const TetMesh tets = small_finger_mesh();
  const QuadraticMesh mesh = make_quadratic(tets);
  CHECK(mesh.corner_nodes == tets.node_mm.size());
  // Euler: nodes - edges + faces - tets = 1 for a ball; each tet has four faces, inner ones twice.
  std::size_t outer_faces = 2 * 2 * (2 * 12 + 12 * 1 + 2 * 1);
  const std::size_t faces = (4 * tets.tets.size() + outer_faces) / 2;
  CHECK(mesh.node_mm.size() - mesh.corner_nodes == tets.node_mm.size() + faces - tets.tets.size() - 1);
  for (const auto& tet : mesh.tets) {
    for (std::size_t e = 0; e < kTetEdges.size(); ++e) {
      const Vector3d middle = 0.5 * (node(mesh, tet[static_cast<std::size_t>(kTetEdges[e][0])]) +
                                     node(mesh, tet[static_cast<std::size_t>(kTetEdges[e][1])]));
      CHECK((node(mesh, tet[4 + e]) - middle).norm() < 1e-12);
    }
  }
}

TEST_CASE("quadratic_mesh: middle nodes belong to base, plates and front like their edges") {
  const QuadraticMesh mesh = make_quadratic(small_finger_mesh());
  for (std::size_t i = 0; i < mesh.node_mm.size(); ++i) CHECK((mesh.fixed[i] == 1) == (mesh.node_mm[i].y() == 0));
  for (int p = 0; p < finsight::kPlates; ++p) {
    const auto& plate = mesh.plate_nodes[static_cast<std::size_t>(p)];
    CHECK(plate.size() == 5 * 3 * 3);  // a slice of 2 x 1 x 1 cells
    for (const int i : plate) CHECK(std::abs(node(mesh, i).y() - (52.5 - 15 * p)) < 2.6);
  }
  CHECK(mesh.front.size() == 2 * 2 * 12);
  for (const auto& triangle : mesh.front) {
    for (const int i : triangle) CHECK(node(mesh, i).z() == 0);
    CHECK((node(mesh, triangle[4]) - 0.5 * (node(mesh, triangle[1]) + node(mesh, triangle[2]))).norm() < 1e-12);
  }
}

TEST_CASE("quadratic_mesh: gradients of a quadratic field are exact at the Gauss points and in the middle") {
  const std::array<Vector3d, 4> corner{Vector3d(1, 2, 0), Vector3d(4, 2.5, 0.3), Vector3d(1.2, 6, 1),
                                       Vector3d(2, 3, 5)};
  std::array<Vector3d, kTetNodes> at;
  std::copy(corner.begin(), corner.end(), at.begin());
  for (std::size_t e = 0; e < kTetEdges.size(); ++e) {
    at[4 + e] =
        0.5 * (corner[static_cast<std::size_t>(kTetEdges[e][0])] + corner[static_cast<std::size_t>(kTetEdges[e][1])]);
  }
  const TetGradients gradients = tet_gradients(corner);
  CHECK(gradients.volume_mm3 ==
        doctest::Approx((corner[1] - corner[0]).cross(corner[2] - corner[0]).dot(corner[3] - corner[0]) / 6));
  Vector3d mean = Vector3d::Zero();
  for (std::size_t g = 0; g < kGaussPoints; ++g) {
    // The Gauss point with barycentric coordinates (a, b, b, b).
    Vector3d x = Vector3d::Zero();
    for (std::size_t a = 0; a < 4; ++a)
      x += (a == g ? (5 + 3 * std::sqrt(5.0)) / 20 : (5 - std::sqrt(5.0)) / 20) * corner[a];
    Vector3d gradient = Vector3d::Zero();
    for (std::size_t a = 0; a < kTetNodes; ++a) gradient += field(at[a]) * gradients.at[g][a];
    CHECK((gradient - field_gradient(x)).norm() < 1e-12);
    mean += x / kGaussPoints;
  }
  const Vector3d middle = 0.25 * (corner[0] + corner[1] + corner[2] + corner[3]);
  CHECK((mean - middle).norm() < 1e-12);
  Vector3d gradient = Vector3d::Zero();
  for (std::size_t a = 0; a < kTetNodes; ++a) gradient += field(at[a]) * gradients.at[kMiddle][a];
  CHECK((gradient - field_gradient(middle)).norm() < 1e-12);
}

TEST_CASE("quadratic_mesh: a face point's weights carry its force and moment and interpolate quadratic fields") {
  const QuadraticMesh mesh = make_quadratic(small_finger_mesh());
  for (const auto& [x, y] : {std::pair{0.3, 21.7}, {-5.9, 3.0}, {3.0, 35.0}, {6.0, 60.0}, {0.0, 0.0}}) {
    const FacePoint point = side_point(mesh, Side::kFront, {x, y});
    CHECK((point.at_mm - Vector3d(x, y, 0)).norm() < 1e-12);
    CHECK((point.inward - Vector3d(0, 0, 1)).norm() < 1e-12);
    double total = 0, interpolated = 0;
    Vector3d moment = Vector3d::Zero();
    for (std::size_t i = 0; i < 6; ++i) {
      total += point.weight[i];
      moment += node(mesh, point.node[i]).cross(point.weight[i] * point.inward);
      interpolated += point.weight[i] * field(node(mesh, point.node[i]));
      CHECK(point.weight[i] >= -0.125 - 1e-12);
    }
    CHECK(total == doctest::Approx(1));
    CHECK((moment - point.at_mm.cross(point.inward)).norm() < 1e-10);
    CHECK(interpolated == doctest::Approx(field(point.at_mm)));
  }
}

TEST_CASE("quadratic_mesh: a point off the face is taken to the nearest one on its edge") {
  const QuadraticMesh mesh = make_quadratic(small_finger_mesh());
  CHECK((side_point(mesh, Side::kFront, {9, 31}).at_mm - Vector3d(6, 31, 0)).norm() < 1e-12);
  CHECK((side_point(mesh, Side::kFront, {-100, 100}).at_mm - Vector3d(-6, 60, 0)).norm() < 1e-12);
}

TEST_CASE("quadratic_mesh: something pushed onto a side meets the outer wall there") {
  const QuadraticMesh mesh = make_quadratic(small_finger_mesh());  // 12 x 60 x 6 mm, from z = 0
  const auto check = [&](Side side, const Eigen::Vector2d& place, const Vector3d& at, const Vector3d& inward) {
    const FacePoint point = side_point(mesh, side, place);
    CHECK((point.at_mm - at).norm() < 1e-12);
    CHECK((point.inward - inward).norm() < 1e-12);
    Vector3d moment = Vector3d::Zero();
    for (std::size_t i = 0; i < 6; ++i) moment += point.weight[i] * node(mesh, point.node[i]);
    CHECK((moment - at).norm() < 1e-10);
  };
  check(Side::kLeft, {2, 31}, {-6, 31, 2}, {1, 0, 0});
  check(Side::kRight, {2, 31}, {6, 31, 2}, {-1, 0, 0});
  check(Side::kBack, {3, 22}, {3, 22, 6}, {0, 0, -1});
  check(Side::kTip, {-2, 4}, {-2, 60, 4}, {0, -1, 0});
  check(Side::kBack, {3, 80}, {3, 60, 6}, {0, 0, -1});  // beside it
}
