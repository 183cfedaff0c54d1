#include "hostgen/finger/front_face.h"

#include <doctest/doctest.h>

#include "tests/finger/surfaces.h"

using namespace finsight;
using namespace finsight::host;
using Eigen::Vector3d;

namespace {

const Eigen::AlignedBox3d kEverything(Vector3d(-99, -99, -99), Vector3d(99, 99, 99));

std::vector<std::size_t> patch(const TriangleSurface& surface, const Eigen::AlignedBox3d& box) {
  return front_patch(surface.point_mm, surface.triangle, box);
}

/// Seen along z: the area of the named triangles.
double area_mm2(const TriangleSurface& surface, const std::vector<std::size_t>& triangles) {
  double twice = 0;
  for (const std::size_t t : triangles) twice -= surface.twice_area(t).z();
  return twice / 2;
}

/// Two walls, 4 mm apart, joined at their lower end; the front one, 20 mm wide, bulges towards -z.
TriangleSurface bulging() {
  TriangleSurface surface = test::cell_surface({{{-10, -5, 0, 5, 10}, {0, 5, 20, 40}, {0, 3, 7, 10}}},
                                               [](int, int j, int k) { return j == 0 || k != 1; });
  for (Vector3d& at : surface.point_mm) {
    if (at.z() == 0) at.z() = 0.02 * at.x() * at.x();
  }
  return surface;
}

}  // namespace

TEST_CASE("front face: finds the whole bulging face and no face behind it") {
  const TriangleSurface surface = bulging();
  const auto front = patch(surface, kEverything);
  CHECK(front.size() == 4 * 3 * 2);
  CHECK(area_mm2(surface, front) == doctest::Approx(20 * 40));
  for (const std::size_t t : front) CHECK(surface.middle(t).z() < 2.5);
}

TEST_CASE("front face: the box decides how far it reaches, the slope what belongs to it") {
  TriangleSurface surface = bulging();
  CHECK(area_mm2(surface, patch(surface, {Vector3d(-11, -1, -1), Vector3d(11, 20, 3)})) == doctest::Approx(20 * 20));
  CHECK(area_mm2(surface, patch(surface, {Vector3d(-11, -1, 5), Vector3d(11, 41, 8)})) == doctest::Approx(20 * 35));
  CHECK(patch(surface, {Vector3d(-11, -1, -9), Vector3d(11, 41, -5)}).empty());
  CHECK(faces_front({0, 0.8, -0.6}));
  CHECK_FALSE(faces_front({0, 0.9, -0.4}));
  CHECK_FALSE(faces_front({0, 0, 1}));
}

TEST_CASE("front face: the nearest point of a triangle is the point itself, or on its nearest edge or corner") {
  const std::array<Vector3d, 3> corner = {Vector3d(0, 0, 1), Vector3d(4, 0, 2), Vector3d(0, 4, 3)};
  const auto near = [&](double x, double y) {
    const Vector3d share = nearest_in_triangle(corner, x, y);
    CHECK(share.sum() == doctest::Approx(1));
    return Vector3d(share[0] * corner[0] + share[1] * corner[1] + share[2] * corner[2]);
  };
  CHECK(near(1, 1).isApprox(Vector3d(1, 1, 1.75)));
  CHECK(near(2, -3).isApprox(Vector3d(2, 0, 1.5)));
  CHECK(near(5, 5).isApprox(Vector3d(2, 2, 2.5)));
  CHECK(near(-1, -1).isApprox(Vector3d(0, 0, 1)));
}
