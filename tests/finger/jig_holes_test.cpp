#include "hostgen/finger/jig_holes.h"

#include <doctest/doctest.h>

#include "hostgen/finger/plate_geometry.h"

using namespace finsight::host;

namespace {

const std::filesystem::path kFingers = FINSIGHT_SOURCE_DIR "/hostgen/fingers";

FingerSpec read(const char* name) { return read_finger_spec(kFingers / name); }

}  // namespace

TEST_CASE("jig holes: both fingers have nine, on the touched face, numbered from 1, apart and along one direction") {
  for (const char* name : {"srm.toml", "bowed.toml"}) {
    CAPTURE(name);
    const FingerSpec spec = read(name);
    const std::vector<JigHole> holes = jig_holes(spec);
    REQUIRE(holes.size() == 9);
    for (std::size_t i = 0; i < holes.size(); ++i) {
      const JigHole& hole = holes[i];
      CHECK(hole.number == static_cast<int>(i) + 1);
      CHECK((hole.contact_mm - front_point_mm(spec, hole.contact_mm.x(), hole.contact_mm.y())).norm() < 1e-9);
      CHECK(hole.contact_mm.y() > spec.touch_y_mm[0]);
      CHECK(hole.contact_mm.y() < spec.touch_y_mm[1]);
      CHECK(std::abs(hole.contact_mm.x()) < spec.half_width.at(hole.contact_mm.y()) - spec.touch_edge_mm);
      CHECK(hole.inward == holes[0].inward);
      for (std::size_t j = 0; j < i; ++j) CHECK((hole.contact_mm - holes[j].contact_mm).norm() >= kJigSpacingMm);
    }
    CHECK(holes[0].inward.norm() == doctest::Approx(1));
    CHECK(holes[0].inward.z() > 0.5);  // into the finger
  }
}

TEST_CASE("jig holes: a flat face is pressed along its normal, a curved one along the mean of its normals") {
  const FingerSpec flat = read("srm.toml");
  const double slope = flat.front_z.slope;
  CHECK((jig_holes(flat)[4].inward - Eigen::Vector3d(0, -slope, 1) / std::hypot(1, slope)).norm() < 1e-12);
  const FingerSpec curved = read("bowed.toml");
  const Eigen::Vector3d inward = jig_holes(curved)[0].inward;
  CHECK(std::abs(inward.x()) < 0.02);  // the same on the left and on the right
  for (const JigHole& hole : jig_holes(curved)) {
    const FrontPoint at = front_point(curved, hole.contact_mm.x(), hole.contact_mm.y());
    CHECK(at.inward.dot(inward) > std::cos(20 * 3.14159265 / 180));
  }
}

TEST_CASE("jig holes: a narrow face has one column, a short one fewer rows") {
  FingerSpec spec = read("srm.toml");
  spec.touch_edge_mm = 16;  // leaves a half width of 2 to 13 mm
  CHECK(jig_holes(spec).size() == 3);
  for (const JigHole& hole : jig_holes(spec)) CHECK(hole.contact_mm.x() == 0);
  spec.touch_edge_mm = 2.3;
  spec.touch_y_mm = {50, 76};
  CHECK(jig_holes(spec).size() == 6);
  spec.touch_y_mm = {50, 60};
  CHECK(jig_holes(spec).size() == 3);
}
