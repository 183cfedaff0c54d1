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
  MarkerPlaces places(model().mount, std::nullopt, model().touch);
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
  MarkerPlaces places(model().mount, std::nullopt, model().touch);
  ZeroPose zero{};
  zero[kTopPlate].displacement_mm = {0, 0, 0.6F};
  places.estimate(zero);
  const Vec3f offset_mm = places.offset_mm()[kTopPlate], turn(0.3F, 0, 0), moved_mm(1, -2, 5);
  PlatePoses poses;
  // The marker's centre, off by the offset, moves by R offset - offset more than the plate's.
  poses.plates[kTopPlate] = {(moved_mm + so3_exp(turn) * offset_mm - offset_mm) / places.print_scale(), turn};
  places.correct(poses);
  CHECK((poses.plates[kTopPlate].displacement_mm - moved_mm).norm() < 1e-5F);
  CHECK(poses.plates[kTopPlate].rotation_rad == turn);
  places.forget();
  places.correct(poses);
  CHECK((poses.plates[kTopPlate].displacement_mm - moved_mm).norm() < 1e-5F);
}

TEST_CASE("marker places: markers that were printed too small seem further away, and move by less than they seem to") {
  MarkerPlaces places(model().mount, std::nullopt, model().touch);
  constexpr float kScale = 0.985F;
  ZeroPose zero{};
  for (std::size_t p = 0; p < kPlates; ++p) {
    const Vec3f from_camera_mm =
        model().mount.T_finger_marker[p].translation() - model().mount.T_finger_camera.translation();
    zero[p].displacement_mm = (1 / kScale - 1) * from_camera_mm;
  }
  places.estimate(zero);
  CHECK(places.print_scale() < 1 - 0.5F * (1 - kScale));  // what a camera or markers beside their places might explain
  CHECK(places.print_scale() > kScale - 0.001F);
  PlatePoses poses;
  poses.plates[kLowPlate].displacement_mm = {0, 4, 0};
  places.correct(poses);
  CHECK(poses.plates[kLowPlate].displacement_mm.y() == doctest::Approx(4 * places.print_scale()));
  places.forget();
  CHECK(places.print_scale() == 1);
}

TEST_CASE("marker places: a measured mount tells what a zero of the nominal mount tells") {
  ZeroPose zero{};
  zero[kMiddlePlate] = {{0.1F, 0.4F, 0.5F}, {0.01F, 0, -0.02F}};
  MountModel measured = model().mount;
  measured.T_finger_marker[kMiddlePlate].translation() += zero[kMiddlePlate].displacement_mm;
  measured.T_finger_marker[kMiddlePlate].linear() =
      so3_exp(zero[kMiddlePlate].rotation_rad) * measured.T_finger_marker[kMiddlePlate].linear();
  MarkerPlaces by_zero(model().mount, std::nullopt, model().touch), by_mount(model().mount, measured, model().touch);
  by_zero.estimate(zero);
  CHECK(by_zero.offset_mm()[kMiddlePlate].norm() > 0.2F);
  CHECK(by_mount.print_scale() == doctest::Approx(by_zero.print_scale()).epsilon(1e-5));
  for (std::size_t p = 0; p < kPlates; ++p) {
    CHECK((by_mount.offset_mm()[p] - by_zero.offset_mm()[p]).norm() < 1e-4F);
  }
  by_mount.estimate(zero);  // and both add up
  CHECK(by_mount.offset_mm()[kMiddlePlate].norm() > 1.5F * by_zero.offset_mm()[kMiddlePlate].norm());
  by_mount.forget();
  CHECK((by_mount.offset_mm()[kMiddlePlate] - by_zero.offset_mm()[kMiddlePlate]).norm() < 1e-4F);
}
