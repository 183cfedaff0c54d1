#include <doctest/doctest.h>

#include <functional>

#include "firmware/input_error.h"
#include "hostgen/finger/triangle_surface.h"
#include "tests/finger/surfaces.h"

using namespace finsight;
using namespace finsight::host;
using test::both;
using test::box_surface;
using test::turned_inside_out;

namespace {

std::string refusal(const TriangleSurface& surface) {
  try {
    check_bounds_a_solid(surface, "finger.stl");
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TriangleSurface cube() { return box_surface({0, 0, 0}, {30, 30, 30}); }

TriangleSurface changed(const std::function<void(TriangleSurface&)>& change) {
  TriangleSurface surface = cube();
  change(surface);
  return surface;
}

/// Two tetrahedra over one triangle's tip: their surfaces share that point, or an edge, and no more.
TriangleSurface touching(bool in_an_edge) {
  TriangleSurface surface;
  surface.point_mm = {{0, 0, 0}, {10, 0, 0}, {0, 10, 0}, {0, 0, 10}, {0, 0, -10}, {-10, 0, 0}, {0, -10, 0}};
  surface.triangle = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  if (in_an_edge) {  // 0-3, on the other side
    surface.triangle.insert(surface.triangle.end(), {{0, 6, 5}, {0, 5, 3}, {0, 3, 6}, {5, 6, 3}});
  } else {
    surface.triangle.insert(surface.triangle.end(), {{0, 6, 5}, {0, 5, 4}, {0, 4, 6}, {5, 6, 4}});
  }
  return surface;
}

}  // namespace

TEST_CASE("closed surface: a solid is accepted, with a hollow in it too") {
  CHECK(refusal(cube()) == "");
  CHECK(refusal(both(cube(), turned_inside_out(box_surface({9, 9, 9}, {12, 20, 12})))) == "");
}

TEST_CASE("closed surface: everything that is not the surface of one solid is refused with what, how many and where") {
  struct Case {
    const char* what;
    TriangleSurface surface;
    std::vector<const char*> expected;
  };
  const Case cases[] = {
      {"hole",
       changed([](auto& s) { s.triangle.erase(s.triangle.begin() + 2); }),
       {"3 open edges", "from (0, 0, 30) mm to (30, 0, 30) mm", "fill the holes"}},
      {"points that miss each other",
       changed([](auto& s) {
         s.point_mm.push_back(s.point_mm[7] + Eigen::Vector3d(0, 0, 1e-4));
         s.triangle[2][2] = 8;
       }),
       {"4 open edges", "(30, 30, 30) mm"}},
      {"flipped",
       changed([](auto& s) { std::swap(s.triangle[5][0], s.triangle[5][1]); }),
       {"1 flipped triangle", "the first triangle 6 around (10, 0, 20) mm", "facing outward"}},
      {"two flipped",
       changed([](auto& s) {
         std::swap(s.triangle[5][0], s.triangle[5][1]);
         std::swap(s.triangle[9][0], s.triangle[9][1]);
       }),
       {"2 flipped triangles", "triangle 6"}},
      {"inside out", turned_inside_out(cube()), {"all 12 triangles facing inward", "flip all normals"}},
      {"twice",
       changed([](auto& s) { s.triangle.push_back(s.triangle[3]); }),
       {"1 duplicate triangle", "triangle 13 around (10, 20, 30) mm"}},
      {"twice, turned",
       changed([](auto& s) {
         auto corner = s.triangle[3];
         std::swap(corner[0], corner[1]);
         s.triangle.push_back(corner);
       }),
       {"1 duplicate triangle"}},
      {"a corner twice",
       changed([](auto& s) {
         s.triangle.push_back({1, 1, 3});
       }),
       {"1 triangle without area", "triangle 13"}},
      {"needle",
       changed([](auto& s) {
         s.point_mm.push_back((s.point_mm[0] + s.point_mm[1]) / 2);
         s.triangle.push_back({0, 8, 1});
       }),
       {"1 triangle without area", "triangle 13 around (15, 0, 0) mm"}},
      {"inner wall",
       changed([](auto& s) {
         s.triangle.push_back({0, 3, 7});
         s.triangle.push_back({0, 7, 4});
       }),
       {"more than two triangles"}},
      {"touching in an edge",
       touching(true),
       {"1 edge with more than two triangles", "from (0, 0, 0) mm to (0, 0, 10) mm"}},
      {"touching in a point", touching(false), {"1 point where parts touch", "at (0, 0, 0) mm"}},
      {"two pieces", both(cube(), box_surface({40, 0, 0}, {50, 5, 5})), {"2 separate pieces", "unite them"}},
      {"a piece in another", both(cube(), box_surface({9, 9, 9}, {12, 12, 12})), {"2 separate pieces"}},
      {"hollow outside",
       both(cube(), turned_inside_out(box_surface({40, 0, 0}, {50, 5, 5}))),
       {"faces inward but lies outside"}},
      {"pieces through each other",
       both(cube(), box_surface({20, 10, 10}, {40, 20, 20})),
       {"triangles that others cut", "does not pass through itself"}},
      {"a corner pulled through the other side",
       changed([](auto& s) {
         s.point_mm[7] = {-5, 10, 12};
       }),
       {"triangles that others cut"}},
  };
  for (const Case& c : cases) {
    INFO(c.what);
    const std::string message = refusal(c.surface);
    CHECK_MESSAGE(message.starts_with("finger.stl: "), message);
    for (const char* expected : c.expected) CHECK_MESSAGE(message.find(expected) != std::string::npos, message);
  }
}
