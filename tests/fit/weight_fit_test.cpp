#include "hostgen/fit/weight_fit.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>

#include "firmware/input_error.h"
#include "hostgen/util/random.h"
#include "tests/fem/box_mesh.h"
#include "tests/model/tiny_model.h"

using namespace finsight;
using namespace finsight::host;

namespace {

FitBasis basis() {
  FitBasis basis;
  for (int i = 0; i < 9; ++i) {
    const Eigen::Vector3d at_mm(14.0 * (i % 3 - 1), 30 + 30 * (i / 3), 0);
    basis.holes.push_back({.number = i + 1, .contact_mm = at_mm, .inward = Eigen::Vector3d::UnitZ()});
  }
  basis.face_axes << 0, 1, 0, 0, 0, 1, 1, 0, 0;
  basis.face_middle_mm = Vec3f(0, 60, 0);
  basis.face_half_mm = {20, 45};
  basis.force_range_n = 6;
  basis.force_tolerance = 0.25F;
  basis.touch_tolerance_mm = 1.5F;
  basis.noise_per_mm = 0.25F;
  return basis;
}

struct Truth {
  double scale = 1.3, creep = 0.1, creep_s = 12, up_mm = 1.5;
};

const FitValues kUsual{.hysteresis = 0.065F, .force_range_n = 6};

/// A finger of the usual material, as other weights have left it, whose pack says 1 / scale of the force, and a touch
/// that is too far up.
WeightRecord record(int hole, double force_n, double seconds, const Truth& truth, Random& random,
                    Hysteresis& material) {
  WeightRecord record{.name = "w" + std::to_string(hole), .hole = hole, .force_n = force_n, .readings = {}};
  const Vec3f at_mm = basis().holes[static_cast<std::size_t>(hole - 1)].contact_mm.cast<float>();
  const auto elastic_n = static_cast<double>(material.elastic_n(static_cast<float>(force_n)));
  for (double t = -1; t < seconds; t += 0.1) {
    TouchReading reading{.time_s = t + 3};
    if (t >= 0) {
      reading.is_valid = true;
      reading.force_n =
          elastic_n / truth.scale * (1 - truth.creep * std::expm1(-t / truth.creep_s)) + 0.02 * random.normal();
      reading.point_mm = at_mm + Vec3f(0, static_cast<float>(truth.up_mm + 0.2 * random.normal()), 0);
    }
    record.readings.push_back(reading);
  }
  material.follow(static_cast<float>(force_n));
  material.follow(0);
  return record;
}

std::vector<WeightRecord> nine(const Truth& truth) {
  Random random(4);
  std::vector<WeightRecord> records;
  Hysteresis material(kUsual);
  for (int hole = 1; hole <= 9; ++hole) records.push_back(record(hole, 3, hole == 5 ? 60 : 5, truth, random, material));
  return records;
}

}  // namespace

TEST_CASE("weight fit: scale, creep and offset come out of nine weights") {
  const WeightFit fit = fit_weights(basis(), nine({}), 9000);
  CHECK(fit.values.force_scale == doctest::Approx(1.3).epsilon(0.02));
  CHECK(fit.values.creep_share == doctest::Approx(0.1).epsilon(0.1));
  CHECK(fit.values.creep_s == doctest::Approx(12).epsilon(0.2));
  CHECK(fit.values.along_mm[0] == doctest::Approx(1.5).epsilon(0.15));
  CHECK(std::abs(fit.values.across_mm[0]) < 0.1F);
  CHECK(fit.values.force_sigma < 0.08F);
  CHECK(fit.values.touch_radius_mm < 1.2F);
  CHECK(fit.values.noise_per_mm == 0.25F);  // without motions a fit moves and scales; its plates still move otherwise
  CHECK(fit.values.fitted_on == 9000);
  CHECK(fit.untold.empty());
  for (const WeightHold& hold : fit.holds) CHECK(std::abs(hold.force_error) < 0.02);
}

TEST_CASE("weight fit: frames of a hanging weight that are not told as a touch do not end it") {
  std::vector<WeightRecord> records = nine({});
  for (WeightRecord& record : records) {
    for (std::size_t i = 0; i < record.readings.size(); ++i) {
      if (i % 7 == 0) record.readings[i] = {.time_s = record.readings[i].time_s};
    }
  }
  const WeightFit fit = fit_weights(basis(), records, 1);
  CHECK(fit.values.force_scale == doctest::Approx(1.3).epsilon(0.02));
  CHECK(fit.values.creep_share == doctest::Approx(0.1).epsilon(0.1));
  for (const WeightHold& hold : fit.holds) CHECK(hold.lasted_s > 4.5);
}

TEST_CASE("weight fit: two short touches are not one") {
  std::vector<WeightRecord> records = nine({});
  for (TouchReading& reading : records[2].readings) {  // hangs from 3 to 8 s
    if (reading.time_s > 4.5 && reading.time_s < 6.5) reading = {.time_s = reading.time_s};
  }
  CHECK_THROWS_WITH_AS(fit_weights(basis(), records, 1), doctest::Contains("two seconds or more"), InputError);
}

TEST_CASE("weight fit: a finger that is softer towards its tip than the pack has a scale that falls along the face") {
  std::vector<WeightRecord> records = nine({});
  for (WeightRecord& record : records) {
    const double v =
        static_cast<double>((basis().holes[static_cast<std::size_t>(record.hole - 1)].contact_mm.y() - 60) / 45);
    for (TouchReading& reading : record.readings) reading.force_n *= std::exp(0.15 * v);
  }
  const FitValues fit = fit_weights(basis(), records, 9000).values;
  CHECK(fit.force_slope[1] == doctest::Approx(-0.15).epsilon(0.2));
  CHECK(std::abs(fit.force_slope[0]) < 0.02F);
  CHECK(fit.force_scale == doctest::Approx(1.3).epsilon(0.02));
  CHECK(force_scale_at(fit, Vec3f(0, 105, 0)) < 0.9F * force_scale_at(fit, Vec3f(0, 60, 0)));
}

namespace {

/// Takes all motions for this touch of 1.5 N.
Model always(const Vec3f& said_mm) {
  test::TinyModel pack;
  pack.answer_always(said_mm, 1.5F);
  return pack.open();
}

/// Weights at nine holes of a finger at which each moves the plates so.
std::vector<WeightRecord> nine_moving(const std::array<PlateMotion, kPlates>& plates) {
  std::vector<WeightRecord> records = nine(Truth{});
  for (WeightRecord& record : records) {
    for (TouchReading& reading : record.readings) {
      reading.poses = {.plates = plates, .quality = Quality::kFresh};
      reading.poses.seen.fill(true);
    }
  }
  return records;
}

}  // namespace

TEST_CASE("weight fit: touches are read again with the fitted motions, by the pack that the device has") {
  const Vec3f said_mm(3, 60, 0);
  const Model model = always(said_mm);
  FitBasis again = basis();
  again.model = &model;
  FingerStatics statics(test::small_finger_spec(), test::small_finger_mesh());
  again.motions.holes.assign(9, PressedPlace(statics, Vec3f(0, 50, 0), 0));
  std::array<PlateMotion, kPlates> plates;
  plates.fill({Vec3f(0, 0, 4), Vec3f::Zero()});
  for (const WeightHold& hold : fit_weights(again, nine_moving(plates), 9000).holds) {
    CHECK((hold.point_mm - said_mm).norm() < 1e-3F);
    CHECK(hold.pack_force_n < 1.51);
  }
}

TEST_CASE("weight fit: what the pack does wrong on its own finger is not taken for the finger's") {
  const Model model = always(Vec3f(3, 60, 0));
  FitBasis again = basis();
  again.model = &model;
  FingerStatics statics(test::small_finger_spec(), test::small_finger_mesh());
  const PressedPlace place(statics, Vec3f(0, 50, 0), 1);
  again.motions.holes.assign(9, place);
  const WeightFit fit = fit_weights(again, nine_moving(place.plates(0.9)), 9000);
  CHECK(fit.values.noise_per_mm < 0.05F);  // they move as the pack's
  CHECK(std::abs(fit.values.along_mm[0]) < 0.01F);
  for (const WeightHold& hold : fit.holds) {
    CHECK((hold.pack_error.touch_mm - (hold.point_mm - hold.truth_mm)).norm() < 1e-3F);
    CHECK(hold.pack_error.log_force == doctest::Approx(std::log(0.9 / 1.5)).epsilon(0.01));
  }
}

TEST_CASE("weight fit: what few weights do not tell is said and stays wide") {
  Random random(5);
  Hysteresis material(kUsual);
  const WeightRecord left = record(4, 3, 5, {}, random, material), right = record(6, 3, 5, {}, random, material);
  const WeightFit fit = fit_weights(basis(), {left, right}, 9000);
  REQUIRE(fit.untold.size() == 2);
  CHECK(fit.untold[0].find("creep") == 0);
  CHECK(fit.untold[1].find("along") != std::string::npos);
  CHECK(fit.values.creep_share == 0);
  CHECK(fit.values.force_sigma > fit_weights(basis(), nine({}), 9000).values.force_sigma);
  CHECK(fit.values.touch_radius_mm > fit_weights(basis(), nine({}), 9000).values.touch_radius_mm);
}

TEST_CASE("weight fit: what a heavy weight has left in the finger is not taken for a part of a light one") {
  Random random(5);
  Hysteresis material(kUsual);
  std::vector<WeightRecord> records;
  for (const auto& [hole, force_n] : {std::pair{2, 6.0}, {5, 1.0}, {8, 1.0}}) {
    records.push_back(record(hole, force_n, 30, {}, random, material));
  }
  for (const WeightHold& hold : fit_weights(basis(), records, 9000).holds) CHECK(std::abs(hold.force_error) < 0.02);
}

TEST_CASE("weight fit: a finger that has rested since the last weight has forgotten it") {
  Random random(5);
  std::vector<WeightRecord> records;
  for (const auto& [hole, force_n] : {std::pair{2, 6.0}, {5, 1.0}, {8, 1.0}}) {
    Hysteresis material(kUsual);
    records.push_back(record(hole, force_n, 30, {}, random, material));
    records.back().left_mm = 0.02;
  }
  for (const WeightHold& hold : fit_weights(basis(), records, 9000).holds) CHECK(std::abs(hold.force_error) < 0.02);
  for (WeightRecord& record : records) record.left_mm = 0.3;
  CHECK(std::abs(fit_weights(basis(), records, 9000).holds[1].force_error) > 0.02);
}

TEST_CASE("weight fit: a finger that is unlike its pack lowers the limit of what is explained, another does not") {
  FitBasis limited = basis();
  limited.explained_above = -2;
  std::vector<WeightRecord> records = nine({});
  for (WeightRecord& record : records) {
    for (TouchReading& reading : record.readings) reading.explained = 3;
  }
  CHECK(fit_weights(limited, records, 1).values.explained_lower == 0);
  for (TouchReading& reading : records[6].readings) reading.explained = reading.is_valid ? -7 : -30;
  const float lower = fit_weights(limited, records, 1).values.explained_lower;
  CHECK(lower > 5);
  CHECK(lower < 10);
}

TEST_CASE("weight fit: a weight at another hole is named with that hole") {
  std::vector<WeightRecord> records = nine({});
  records[2].hole = 7;
  CHECK_THROWS_WITH_AS(fit_weights(basis(), records, 9000), doctest::Contains("w3: hole: found 7"), InputError);
}

TEST_CASE("weight fit: a wrong weight is named with the one that fits the others") {
  std::vector<WeightRecord> records = nine({});
  records[6].force_n = 6;
  CHECK_THROWS_WITH_AS(fit_weights(basis(), records, 9000), doctest::Contains("w7: mass_g: found 612"), InputError);
}

TEST_CASE("weight fit: two weights that contradict each other are both named") {
  Random random(5);
  Hysteresis material(kUsual);
  WeightRecord left = record(4, 3, 5, {}, random, material), right = record(6, 3, 5, {}, random, material);
  right.force_n = 6;
  CHECK_THROWS_WITH_AS(fit_weights(basis(), {left, right}, 9000),
                       doctest::Contains("w4: mass_g: found 306, expected about 6"), InputError);
}

TEST_CASE("weight fit: one weight that no finger of the spec's material would show so is refused") {
  Random random(5);
  Hysteresis material(kUsual);
  WeightRecord one = record(4, 3, 5, {}, random, material);
  one.force_n = 30;
  CHECK_THROWS_WITH_AS(fit_weights(basis(), {one}, 9000), doctest::Contains("three times as stiff"), InputError);
  CHECK_THROWS_WITH_AS(check_weights(basis(), {one}), doctest::Contains("three times as stiff"), InputError);
}

TEST_CASE("weight fit: forces that the fit leaves apart are stated as wide as they are") {
  std::vector<WeightRecord> records = nine({});
  const float usual = fit_weights(basis(), records, 9000).values.force_sigma;
  for (std::size_t i = 0; i < records.size(); ++i) records[i].force_n *= i % 2 ? 1.2 : 0.85;
  CHECK(fit_weights(basis(), records, 9000).values.force_sigma > 2 * usual);
}

TEST_CASE("weight fit: a recording without a touch is refused, and a hole that the jig does not have") {
  std::vector<WeightRecord> records = nine({});
  for (TouchReading& reading : records[0].readings) reading.is_valid = false;
  CHECK_THROWS_WITH_AS(fit_weights(basis(), records, 9000), doctest::Contains("w1: touched for"), InputError);
  records = nine({});
  records[0].hole = 10;
  CHECK_THROWS_WITH_AS(fit_weights(basis(), records, 9000), doctest::Contains("1 to 9"), InputError);
}
