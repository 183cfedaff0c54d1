#include "firmware/device/page_publisher.h"

#include <doctest/doctest.h>

#include <Eigen/Geometry>

using namespace finsight;

TEST_CASE("page publisher: the surface of a mesh is what belongs to one tetrahedron only, and faces outwards") {
  // Two that share the face 1 2 3; node 5 belongs to none.
  const std::vector<float> rest_mm = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 1, 1, 9, 9, 9};
  const std::vector<std::int32_t> tets = {0, 1, 2, 3, 1, 2, 3, 4};
  ShapeModel shape;
  shape.nodes = 6;
  shape.tets = 2;
  shape.rest_mm = rest_mm;
  shape.tet_nodes = tets;
  const SurfaceMesh surface = surface_of(shape);
  CHECK(surface.nodes == std::vector<std::int32_t>{0, 1, 2, 3, 4});
  REQUIRE(surface.triangles.size() == 3 * 6);
  // Six times the volume within, by the divergence theorem; of each tetrahedron it is the determinant of its edges.
  const auto point = [&](std::int32_t i) {
    const auto node = static_cast<std::size_t>(3 * surface.nodes[static_cast<std::size_t>(i)]);
    return Eigen::Vector3f(rest_mm[node], rest_mm[node + 1], rest_mm[node + 2]);
  };
  float volume = 0;
  for (std::size_t t = 0; t < surface.triangles.size(); t += 3) {
    volume += point(surface.triangles[t]).dot(point(surface.triangles[t + 1]).cross(point(surface.triangles[t + 2])));
  }
  CHECK(volume == doctest::Approx(1 + 2));
}
