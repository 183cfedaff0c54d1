#include "firmware/loop/marker_places.h"

#include <doctest/doctest.h>

#include "firmware/geometry/so3.h"
#include "firmware/model/rest_spread.h"
#include "tests/model/tiny_model.h"
#include "tests/random.h"

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
  const Vec3f of_marker_mm = moved_mm + so3_exp(turn) * offset_mm - offset_mm;
  poses.plates[kTopPlate] = {places.R_shown_finger() * of_marker_mm / places.print_scale(),
                             places.R_shown_finger() * turn};
  places.correct(poses);
  CHECK((poses.plates[kTopPlate].displacement_mm - moved_mm).norm() < 1e-5F);
  CHECK((poses.plates[kTopPlate].rotation_rad - turn).norm() < 1e-6F);
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

TEST_CASE("marker places: a camera that is turned against the finger sees all motions turned") {
  const Vec3f turn(0.02F, 0, -0.015F);
  MarkerPlaces places(model().mount, std::nullopt, model().touch);
  ZeroPose zero{};
  for (std::size_t p = 0; p < kPlates; ++p) {
    const Vec3f from_camera_mm =
        model().mount.T_finger_marker[p].translation() - model().mount.T_finger_camera.translation();
    zero[p] = {turn.cross(from_camera_mm), turn};
  }
  places.estimate(zero);
  const Vec3f moved_mm(1, -2, 5), turned(0.1F, 0, 0.02F);
  const Eigen::Matrix3f seen = so3_exp(turn);
  PlatePoses poses;
  poses.plates[kTopPlate] = {seen * moved_mm, seen * turned};
  const float before_mm = (poses.plates[kTopPlate].displacement_mm - moved_mm).norm();
  places.correct(poses);
  CHECK((poses.plates[kTopPlate].displacement_mm - moved_mm).norm() < 0.4F * before_mm);
  CHECK((poses.plates[kTopPlate].rotation_rad - turned).norm() < 0.4F * (seen * turned - turned).norm());
}

TEST_CASE("marker places: what a zero leaves open is as large as the errors that remain") {
  const Eigen::Matrix<double, kPoseDims, 10> common = common_rest_spread(model().mount);
  const double own_mm = model().touch.marker_tolerance_mm, own_rad = model().touch.marker_tolerance_rad;
  PlatePoses truth;
  truth.plates = {PlateMotion{{1, -2, 8}, {0.25F, 0.02F, -0.05F}}, PlateMotion{{0.5F, -1, 5}, {0.2F, 0, 0}},
                  PlateMotion{{0, -1, 3}, {0.1F, 0, 0.05F}}};
  MarkerPlaces places(model().mount, std::nullopt, model().touch);
  CHECK(places.doubts(truth).empty());
  test::Random random(5);
  constexpr int kFingers = 2000;
  double error_sq = 0, stated_sq = 0;
  for (int finger = 0; finger < kFingers; ++finger) {
    Eigen::Matrix<double, 10, 1> cause;
    for (int i = 0; i < 10; ++i) cause[i] = random.normal();
    const PoseVectorOf<double> by_common = common * cause;
    const Eigen::Matrix3f seen = so3_exp(Vec3f((kCameraSpread_rad * cause.segment<3>(3)).cast<float>()));
    ZeroPose zero;
    PlatePoses poses;
    poses.quality = Quality::kFresh;
    for (std::size_t p = 0; p < kPlates; ++p) {
      const Vec3f beside_mm(static_cast<float>(own_mm * random.normal()), static_cast<float>(own_mm * random.normal()),
                            static_cast<float>(own_mm * random.normal()));
      const Vec3f tilt(static_cast<float>(own_rad * random.normal()), static_cast<float>(own_rad * random.normal()),
                       static_cast<float>(own_rad * random.normal()));
      const int first = 6 * static_cast<int>(p);
      zero[p] = {by_common.segment<3>(first).cast<float>() + beside_mm,
                 by_common.segment<3>(first + 3).cast<float>() + tilt};
      const PlateMotion& plate = truth.plates[p];
      const Vec3f of_marker_mm = plate.displacement_mm + so3_exp(plate.rotation_rad) * beside_mm - beside_mm;
      poses.plates[p] = {seen * of_marker_mm / static_cast<float>(1 + kPrintSpread * cause[6]),
                         seen * plate.rotation_rad};
    }
    places.estimate(zero);
    places.correct(poses);
    for (const PoseVector& doubt : places.doubts(poses)) {
      for (int p = 0; p < kPlates; ++p) stated_sq += static_cast<double>(doubt.segment<3>(6 * p).squaredNorm());
    }
    for (std::size_t p = 0; p < kPlates; ++p) {
      error_sq +=
          static_cast<double>((poses.plates[p].displacement_mm - truth.plates[p].displacement_mm).squaredNorm());
    }
  }
  MESSAGE("error " << std::sqrt(error_sq / kFingers) << " mm, stated " << std::sqrt(stated_sq / kFingers));
  CHECK(stated_sq < 1.15 * error_sq);  // less: only the largest directions are kept
  CHECK(stated_sq > 0.75 * error_sq);
}

TEST_CASE("marker places: a zero that shows markers in their places leaves less open than one that does not") {
  MarkerPlaces places(model().mount, std::nullopt, model().touch);
  PlatePoses poses;
  poses.plates[kTopPlate] = {{1, -2, 8}, {0.25F, 0, 0}};
  const auto open_mm = [&](const ZeroPose& zero) {
    places.estimate(zero);
    float sq = 0;
    for (const PoseVector& doubt : places.doubts(poses)) sq += doubt.head<3>().squaredNorm();
    return std::sqrt(sq);
  };
  ZeroPose crooked{};
  crooked[kTopPlate] = {{0, 1, -1}, {0.03F, 0, 0.03F}};
  CHECK(open_mm(crooked) > 1.5F * open_mm({}));
  places.forget();
  CHECK(places.doubts(poses).empty());
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
