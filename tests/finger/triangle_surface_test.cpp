#include "hostgen/finger/triangle_surface.h"

#include <doctest/doctest.h>

#include "firmware/input_error.h"
#include "hostgen/util/common.h"
#include "tests/finger/surfaces.h"
#include "tests/model/scratch_folder.h"

using namespace finsight;
using namespace finsight::host;
using Eigen::Vector3d;

namespace {

/// The message with which a file of these bytes is refused; empty if it is read.
std::string refusal(const std::string& name, const std::string& bytes) {
  const test::ScratchFolder folder;
  std::ofstream(folder / name, std::ios::binary) << bytes;
  try {
    read_triangles(folder / name, 1);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("triangle surface: every format gives the same points and triangles, in mm") {
  const test::ScratchFolder folder;
  const TriangleSurface box = test::box_surface({-1.5, 0, 2}, {3, 0.25, 7.125});
  test::write_binary_stl(folder / "binary.stl", box);
  test::write_ascii_stl(folder / "ascii.stl", box);
  test::write_ascii_ply(folder / "box.ply", box);
  test::write_obj(folder / "box.obj", box);
  for (const char* name : {"binary.stl", "ascii.stl", "box.ply", "box.obj"}) {
    INFO(name);
    const TriangleSurface read = read_triangles(folder / name, 10);
    CHECK(read.point_mm.size() == 8);
    REQUIRE(read.triangle.size() == 12);
    for (std::size_t t = 0; t < 12; ++t) {
      for (std::size_t i = 0; i < 3; ++i) CHECK(read.corners(t)[i].isApprox(10 * box.corners(t)[i], 1e-6));
    }
  }
}

TEST_CASE("triangle surface: a name in capitals is a name") {
  const test::ScratchFolder folder;
  const TriangleSurface box = test::box_surface({0, 0, 0}, {3, 4, 5});
  test::write_binary_stl(folder / "BOX.STL", box);
  CHECK(read_triangles(folder / "BOX.STL", 1).triangle.size() == 12);
}

TEST_CASE("triangle surface: points that only rounding parted are one, and triangles between them vanish") {
  const test::ScratchFolder folder;
  TriangleSurface parted;
  const TriangleSurface box = test::box_surface({0, 0, 0}, {30, 40, 50});
  for (std::size_t t = 0; t < box.triangle.size(); ++t) {  // every triangle with corners of its own
    const int first = static_cast<int>(parted.point_mm.size());
    for (const Vector3d& corner : box.corners(t)) {
      const double off = 0.0001 * static_cast<double>(parted.point_mm.size() % 5);
      parted.point_mm.push_back(corner + Vector3d(off, -off, off / 2));
    }
    parted.triangle.push_back({first, first + 1, first + 2});
  }
  parted.point_mm.push_back(parted.point_mm[0] + Vector3d(0.0001, 0, 0));
  parted.triangle.push_back({0, 1, static_cast<int>(parted.point_mm.size()) - 1});
  test::write_obj(folder / "box.obj", parted);
  const TriangleSurface read = read_triangles(folder / "box.obj", 1);
  CHECK(read.point_mm.size() == 8);
  CHECK(read.triangle.size() == 12);
  CHECK_NOTHROW(check_bounds_a_solid(read, "box"));
}

TEST_CASE("triangle surface: its shortest edge and its thinnest triangle can be told") {
  const std::string text = hardness_text(test::box_surface({0, 0, 0}, {0.25, 40, 50}));
  CHECK_MESSAGE(text.find("12 triangles, the shortest edge 0.25 mm at (0") == 0, text);
  CHECK_MESSAGE(text.find("the thinnest triangle 1:200") != std::string::npos, text);
}

TEST_CASE("triangle surface: a four-sided face becomes two triangles, groups become one surface") {
  const test::ScratchFolder folder;
  std::ofstream(folder / "faces.obj") << "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\n"
                                         "g square\nf 1 2 3 4\ng other\nf 1 2 5\n";
  const TriangleSurface read = read_triangles(folder / "faces.obj", 1);
  CHECK(read.point_mm.size() == 5);
  CHECK(read.triangle.size() == 3);
  CHECK(read.twice_area(0).isApprox(Vector3d(0, 0, 1)));
  CHECK(read.twice_area(1).isApprox(Vector3d(0, 0, 1)));
  CHECK(read.labelled.at("square") == std::vector<int>{0, 1, 2, 3});
  CHECK(read.labelled.at("other").size() == 3);
}

TEST_CASE("triangle surface: the solids of an ASCII STL keep their names") {
  const test::ScratchFolder folder;
  std::ofstream file(folder / "two.stl");
  for (const char* name : {"foot", "skin"}) {
    file << "solid " << name << "\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
         << "endloop\nendfacet\nendsolid " << name << "\n";
  }
  file.close();
  const TriangleSurface read = read_triangles(folder / "two.stl", 1);
  CHECK(read.labelled.size() == 2);
  CHECK(read.labelled.contains("foot"));
  CHECK(read.labelled.contains("skin"));
}

TEST_CASE("triangle surface: files that hold no surface are refused by name and reason") {
  CHECK_THROWS_AS(read_triangles("/nowhere/finger.stl", 1), InputError);
  CHECK(refusal("finger.step", "ISO-10303-21;").find(".stl, .ply or .obj") != std::string::npos);
  struct Case {
    const char *name, *bytes;
  };
  for (const Case& c : {Case{"a.stl", ""}, Case{"b.stl", "not a surface"}, Case{"c.ply", "ply\nformat nonsense"},
                        Case{"d.obj", "v 0 0 0\n"}, Case{"e.obj", ""}}) {
    const std::string message = refusal(c.name, c.bytes);
    CHECK_MESSAGE(message.find(c.name) != std::string::npos, c.name, ": ", message);
  }
  CHECK(refusal("nan.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n") != "");
}

TEST_CASE("triangle surface: a binary file cut off anywhere is refused, never read half") {
  const test::ScratchFolder folder;
  test::write_binary_stl(folder / "box.stl", test::box_surface({0, 0, 0}, {1, 1, 1}));
  const std::string bytes = read_file(folder / "box.stl");
  CHECK(refusal("whole.stl", bytes) == "");
  for (std::size_t length = 0; length < bytes.size(); length += 29) {
    CHECK_MESSAGE(refusal("cut.stl", bytes.substr(0, length)) != "", length);
  }
  CHECK(refusal("cut.stl", bytes.substr(0, 300)).find("found 300 bytes, expected 684 for its 12") != std::string::npos);
}

TEST_CASE("triangle surface: the winding number tells inside, outside and hollows") {
  const TriangleSurface hollow = test::both(test::box_surface({0, 0, 0}, {9, 9, 9}),
                                            test::turned_inside_out(test::box_surface({3, 3, 3}, {6, 6, 6})));
  CHECK(winding_number(hollow, {1, 2, 1.5}) == doctest::Approx(1));
  CHECK(winding_number(hollow, {4, 4, 5}) == doctest::Approx(0));
  CHECK(winding_number(hollow, {4, 4, 50}) == doctest::Approx(0));
  CHECK(winding_number(hollow, {-0.01, 4, 5}) == doctest::Approx(0));
}
