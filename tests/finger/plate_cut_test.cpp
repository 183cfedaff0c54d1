#include "hostgen/finger/plate_cut.h"

#include <doctest/doctest.h>

#include "firmware/input_error.h"
#include "tests/finger/surfaces.h"

using namespace finsight;
using namespace finsight::host;
using Eigen::AlignedBox3d;
using Eigen::Vector3d;

namespace {

/// A beam from x = -20 to 20, y = 10 to 20, and under its middle a plate 2 mm thick and 6 mm deep, from -5 to `end`.
TriangleSurface beam_with_plate(double beam_from = -20, double plate_to = 5) {
  return test::cell_surface({{{-20, -5, 0, 5, 20}, {8, 10, 20}, {-6, -3, 3, 6}}}, [=](int i, int j, int k) {
    const double x[] = {-12, -2, 2, 12};
    return j == 1 ? x[i] > beam_from : k == 1 && x[i] > -5 && x[i] < plate_to;
  });
}

const PlateBox kPlate = {AlignedBox3d(Vector3d(-6, 7, -4), Vector3d(6, 10, 4)), 1, 1};

/// Axes x, y, z become y, z, x, `times` over; mirrored too, if wanted.
Vector3d turned(const Vector3d& at, int times, bool mirrored) {
  Vector3d result = at;
  for (int i = 0; i < 3; ++i) result[(i + times) % 3] = at[i];
  return mirrored ? Vector3d(-result) : result;
}

/// Area of the joint: outlines of holes run the other way round.
double area_mm2(const TriangleSurface& surface, const Facet& facet) {
  Vector3d twice = Vector3d::Zero();
  for (const auto& outline : facet.outlines) {
    for (std::size_t i = 0; i < outline.size(); ++i) {
      twice += surface.point_mm[outline[i]].cross(surface.point_mm[outline[(i + 1) % outline.size()]]);
    }
  }
  return twice.norm() / 2;
}

std::string refusal(TriangleSurface surface, const PlateBox& plate) {
  try {
    snap_to_box(surface, plate.box_mm);
    cut_at_joined_face(surface, plate, "finger.toml", "plates.top.box");
    plate_triangles(surface, plate, "finger.toml", "plates.top.box");
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("plate cut: the joint is where beam and plate touch, whichever face of the box that is in") {
  for (const bool mirrored : {false, true}) {
    for (int times = 0; times < 3; ++times) {
      INFO(mirrored, times);
      TriangleSurface surface = beam_with_plate();
      for (Vector3d& at : surface.point_mm) at = turned(at, times, mirrored);
      if (mirrored) surface = test::turned_inside_out(surface);
      PlateBox plate{{}, (1 + times) % 3, mirrored ? -1 : 1};
      plate.box_mm.extend(turned(kPlate.box_mm.min(), times, mirrored));
      plate.box_mm.extend(turned(kPlate.box_mm.max(), times, mirrored));
      const std::size_t before = surface.triangle.size();
      const Facet joint = cut_at_joined_face(surface, plate, "", "");
      CHECK(joint.outlines.size() == 1);
      CHECK(area_mm2(surface, joint) == doctest::Approx(60));
      CHECK(surface.triangle.size() == before);                            // nothing to split
      CHECK(plate_triangles(surface, plate, "", "").size() == 4 + 8 + 4);  // lower face, long and short sides
    }
  }
}

TEST_CASE("plate cut: through the plate's thickness, the surface stays closed and keeps its volume") {
  TriangleSurface surface = beam_with_plate();
  const double volume = test::volume_mm3(surface);
  PlateBox plate = kPlate;
  plate.box_mm.max().y() = 9.25;
  const Facet joint = cut_at_joined_face(surface, plate, "", "");
  CHECK(area_mm2(surface, joint) == doctest::Approx(60));
  for (const int point : joint.outlines.at(0)) CHECK(surface.point_mm[point].y() == 9.25);
  CHECK_NOTHROW(check_bounds_a_solid(surface, ""));
  CHECK(test::volume_mm3(surface) == doctest::Approx(volume));
  for (const std::size_t t : plate_triangles(surface, plate, "", "")) {
    for (const Vector3d& corner : surface.corners(t)) CHECK(corner.y() <= 9.25);
  }
}

TEST_CASE("plate cut: where the plate reaches beyond its beam, its free upper side is no joint") {
  TriangleSurface surface = beam_with_plate(0);  // the beam begins at x = 0, the plate at -5
  const Facet joint = cut_at_joined_face(surface, kPlate, "", "");
  CHECK(area_mm2(surface, joint) == doctest::Approx(30));
  double free_area_mm2 = 0;
  for (const std::size_t t : plate_triangles(surface, kPlate, "", "")) {
    if (surface.middle(t).y() == 10) free_area_mm2 += surface.twice_area(t).norm() / 2;
  }
  CHECK(free_area_mm2 == doctest::Approx(30));
}

TEST_CASE("plate cut: a plate with a hole through it has a joint with a hole, marked inside") {
  TriangleSurface surface = test::cell_surface(
      {{{-9, -6, -2, 2, 6, 9}, {0, 2, 9}, {-9, -6, -2, 2, 6, 9}}},
      [](int i, int j, int k) { return j == 1 || (i > 0 && i < 4 && k > 0 && k < 4 && !(i == 2 && k == 2)); });
  const PlateBox plate = {AlignedBox3d(Vector3d(-7, -1, -7), Vector3d(7, 2, 7)), 1, 1};
  const Facet joint = cut_at_joined_face(surface, plate, "", "");
  CHECK(joint.outlines.size() == 2);
  CHECK(area_mm2(surface, joint) == doctest::Approx(144 - 16));
  REQUIRE(joint.holes_mm.size() == 1);
  CHECK(joint.holes_mm[0].y() == 2);
  CHECK(std::abs(joint.holes_mm[0].x()) < 2);
  CHECK(std::abs(joint.holes_mm[0].z()) < 2);
}

TEST_CASE("plate cut: a surface that rounding put beside a face of the box is moved onto it") {
  TriangleSurface surface = beam_with_plate();
  PlateBox plate = kPlate;
  plate.box_mm.max().y() = 10.0004;
  snap_to_box(surface, plate.box_mm);
  const std::size_t before = surface.triangle.size();
  CHECK(area_mm2(surface, cut_at_joined_face(surface, plate, "", "")) == doctest::Approx(60));
  CHECK(surface.triangle.size() == before);
}

TEST_CASE("plate cut: boxes that do not hold a plate joined at that face are refused with the field and the reason") {
  const auto with_box = [](const Vector3d& lowest, const Vector3d& highest) {
    return PlateBox{{lowest, highest}, 1, 1};
  };
  CHECK(refusal(beam_with_plate(), kPlate) == "");
  const std::pair<PlateBox, const char*> cases[] = {
      {with_box({-4, 7, -4}, {6, 10, 4}), "reaches beyond the edges of the box's +y face"},
      {with_box({-6, 9, -4}, {6, 10, 4}), "passes through a side of the box"},
      {with_box({-6, 7, -4}, {6, 15, 4}), "no part of the finger that crosses"},
      {with_box({10, 1, -4}, {16, 9, 4}), "no part of the finger that crosses"},
      {with_box({-25, 12, -9}, {25, 15, 9}), "passes through a side of the box"},
  };
  for (const auto& [plate, reason] : cases) {
    const std::string message = refusal(beam_with_plate(), plate);
    CHECK_MESSAGE(message.find("finger.toml: plates.top.box") == 0, message);
    CHECK_MESSAGE(message.find(reason) != std::string::npos, message);
  }
  PlateBox other_face = kPlate;
  other_face.side = -1;
  CHECK_MESSAGE(refusal(beam_with_plate(), other_face).find("the box's -y face") != std::string::npos,
                refusal(beam_with_plate(), other_face));
}
