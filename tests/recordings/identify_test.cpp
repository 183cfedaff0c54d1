#include "hostgen/recordings/identify.h"

#include <doctest/doctest.h>

#include <cmath>

#include "hostgen/fem/statics.h"
#include "hostgen/finger/grid.h"
#include "tests/fem/box_mesh.h"
#include "tests/recordings/synthetic_recordings.h"

using namespace finsight;
using namespace finsight::host;

namespace {

/// A small column. The spec's front wall sets the depth of its lower half and the back wall that of its upper half (6
/// mm for walls of 4 mm); side walls and base ring do not affect it.
TetMesh column(const FingerSpec& spec) {
  TetMesh mesh = test::small_finger_mesh();
  for (auto& node : mesh.node_mm) {
    const double wall_mm = node[1] < 30 ? spec.front_wall_mm : spec.back_wall_mm;
    node[2] *= (node[1] == 30 ? (spec.front_wall_mm + spec.back_wall_mm) / 2 : wall_mm) / 4;
  }
  return mesh;
}

FingerSpec column_spec(double front_wall_mm, double back_wall_mm, double youngs_modulus_mpa) {
  FingerSpec spec = test::small_finger_spec();
  spec.front_wall_mm = front_wall_mm;
  spec.back_wall_mm = back_wall_mm;
  spec.side_wall_mm = 5;
  spec.base_ring_mm = 8;
  spec.youngs_modulus_mpa = youngs_modulus_mpa;
  spec.beam_mm = 2;
  spec.plate_mm = 1;
  for (int p = 0; p < kPlates; ++p) {
    PlateSpec& plate = spec.plates[static_cast<std::size_t>(p)];
    plate.beam_y_mm = 52 - 15 * p;
    plate.across = {-0.5, 0.5};
    plate.deep = {0.4, 0.6};
  }
  place_markers(spec);
  return spec;
}

/// Pushes on the column, measured by a camera that sees only the top plate.
std::vector<RecordedPush> pushes_on(const FingerSpec& spec) {
  FingerStatics statics(spec, column(spec));
  std::vector<RecordedPush> pushes;
  for (const double y_mm : {24.0, 31.0, 40.0, 52.0}) {
    statics.reset();
    const float x_mm = y_mm < 35 ? 3 : -3;
    REQUIRE(statics.load(Vec3f(x_mm, static_cast<float>(y_mm), 0), 0.1));
    const FemState state = statics.state();
    RecordedPush push{.point_mm = state.point_mm,
                      .push_mm = static_cast<double>((state.contact_mm - state.point_mm).z()),
                      .poses = {}};
    push.poses.plates = state.plates;
    push.poses.seen = {true, false, false};
    pushes.push_back(push);
  }
  return pushes;
}

const IdentifiedNumber& number(const Identification& found, const std::string& key) {
  for (const IdentifiedNumber& one : found.numbers) {
    if (one.key == key) return one;
  }
  FAIL("no number " << key);
  return found.numbers.front();
}

}  // namespace

TEST_CASE("identify: recovers changed walls; reports and keeps the numbers that pushes do not determine") {
  const Identification found = identify_spec(column_spec(4, 4, 10), pushes_on(column_spec(4.6, 3.5, 14)), column, 3);
  const IdentifiedNumber &front = number(found, "shape.front_wall_mm"), &back = number(found, "shape.back_wall_mm");
  REQUIRE(front.identifiable);
  REQUIRE(back.identifiable);
  // Plate motions only determine the ratio of the halves' stiffness.
  CHECK(front.after / back.after == doctest::Approx(4.6 / 3.5).epsilon(0.03));
  CHECK(front.sigma > 0);
  CHECK(found.rms_after_mm < 0.2 * found.rms_before_mm);
  for (const char* key : {"material.youngs_modulus_mpa", "shape.side_wall_mm", "shape.base_ring_mm"}) {
    CHECK_FALSE(number(found, key).identifiable);
    CHECK(number(found, key).after == doctest::Approx(number(found, key).before));
  }
  CHECK(found.failed == 0);
}

TEST_CASE("identify: correct numbers stay as they are") {
  const FingerSpec spec = column_spec(4, 4, 10);
  const Identification found = identify_spec(spec, pushes_on(spec), column, 1);
  CHECK(found.rms_before_mm < 0.01);  // the pushes are those of this very column
  CHECK(found.failed == 0);
  for (const IdentifiedNumber& number : found.numbers) {
    CAPTURE(number.key);
    CHECK(number.after == doctest::Approx(number.before).epsilon(0.005));
  }
}

TEST_CASE("identify: pushes of a recording start at the row of least motion, and outliers are left out") {
  const FingerSpec spec = column_spec(4, 4, 10);
  const RecordedMotion motion = test::synthetic_recordings({.outlier = true});
  const auto pushes = recorded_pushes(motion, spec, 5);
  REQUIRE(pushes.size() > 5);
  CHECK(pushes.size() <= 10);
  for (const RecordedPush& push : pushes) {
    CHECK(push.push_mm > 0.5);
    CHECK(push.poses.seen[kTopPlate]);
    CHECK_FALSE(push.poses.seen[kLowPlate]);
    CHECK(push.poses.plates[kTopPlate].displacement_mm.norm() < 40);
  }
}

TEST_CASE("identify: says when it changed nothing, and why") {
  const FingerSpec spec = column_spec(4, 4, 10);
  std::vector<RecordedPush> pushes = {pushes_on(spec).front()};
  pushes[0].poses.plates[kTopPlate].rotation_rad.setZero();  // nothing moves like that
  pushes[0].poses.plates[kTopPlate].displacement_mm = Vec3f(0, 3, 0);
  const Identification found = identify_spec(spec, pushes, column);
  for (const IdentifiedNumber& number : found.numbers) CHECK(number.after == doctest::Approx(number.before));
  CHECK_FALSE(found.changed);
  CHECK(found.why_unchanged == "the recordings determine none of them");
  CHECK(identify_spec(spec, pushes_on(column_spec(3.4, 4.4, 10)), column).changed);
}
