#include "firmware/loop/marker_places.h"

#include <doctest/doctest.h>

#include "firmware/geometry/so3.h"
#include "tests/model/tiny_model.h"

using namespace finsight;

namespace {

const Model& model() {
  static const Model the_model = test::TinyModel().open();
  return the_model;
}

}  // namespace

TEST_CASE("marker places: one marker that sits beside its place is told from a camera that does") {
  MarkerPlaces places(model().mount, model().touch);
  ZeroPose zero{};
  zero[kMiddlePlate].displacement_mm = {0, 0, 0.6F};
  places.estimate(zero);
  CHECK((places.offset_mm()[kMiddlePlate] - Vec3f(0, 0, 0.6F)).norm() < 0.25F);
  CHECK(places.offset_mm()[kTopPlate].norm() < 0.25F);

  for (PlateMotion& plate : zero) plate.displacement_mm = {0.6F, 0, 0.6F};
  places.estimate(zero);
  for (const Vec3f& offset_mm : places.offset_mm()) CHECK(offset_mm.norm() < 0.1F);
}

TEST_CASE("marker places: a turned plate is shown where it is, not where its marker is") {
  MarkerPlaces places(model().mount, model().touch);
  ZeroPose zero{};
  zero[kTopPlate].displacement_mm = {0, 0, 0.6F};
  places.estimate(zero);
  const Vec3f offset_mm = places.offset_mm()[kTopPlate], turn(0.3F, 0, 0), moved_mm(1, -2, 5);
  PlatePoses poses;
  // The marker's centre, off by the offset, moves by R offset - offset more than the plate's.
  poses.plates[kTopPlate] = {moved_mm + so3_exp(turn) * offset_mm - offset_mm, turn};
  places.correct(poses);
  CHECK((poses.plates[kTopPlate].displacement_mm - moved_mm).norm() < 1e-5F);
  CHECK(poses.plates[kTopPlate].rotation_rad == turn);
  places.forget();
  places.correct(poses);
  CHECK((poses.plates[kTopPlate].displacement_mm - moved_mm).norm() < 1e-5F);
}
