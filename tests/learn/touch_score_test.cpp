#include "hostgen/learn/touch_score.h"

#include <doctest/doctest.h>

#include <cmath>

#include "firmware/touch/touch_stage.h"
#include "hostgen/util/random.h"

using namespace finsight;
using namespace finsight::host;

namespace {

// Errors along y of 0.01, 0.02 ... 1.00 mm, radius 0.2 mm, all on one path.
std::vector<TouchTrial> ramp(std::int32_t path, float plate_motion_mm) {
  std::vector<TouchTrial> trials;
  for (int i = 1; i <= 100; ++i) {
    TouchTrial trial;
    trial.path = path;
    trial.truth_mm = Vec3f(0, float(i % 2), 0);
    trial.error_mm = Vec3f(0, 0.01f * float(i), 0);
    trial.plate_motion_mm = plate_motion_mm;
    trial.radius_68_mm = 0.2f;
    trial.wrench_error.fill(-0.02f * float(i));
    trial.wrench_sigma.fill(0.5f);
    trials.push_back(trial);
  }
  return trials;
}

}  // namespace

TEST_CASE("touch score: calibration makes the radius hold 68 % of the errors and each deviation 68.3 %") {
  const Calibration calibration = calibrate(ramp(0, 5), 2);
  REQUIRE(calibration.radius_curve.size() == 3);  // all at 5 mm of plate motion
  CHECK(calibrated_radius_mm(calibration.radius_curve, 5, 0.2f) == doctest::Approx(0.68).epsilon(0.02));
  for (const double factor : calibration.wrench) CHECK(factor == doctest::Approx(2 * 0.6827 / 0.5).epsilon(0.02));
  TouchModelData model;
  model.output_mean.assign(TouchModel::kOutputs, 0.0f);
  apply(calibration, model);
  CHECK(model.radius_curve == calibration.radius_curve);
  for (std::size_t i = 0; i < 15; ++i) CHECK(model.output_mean[i] == 0);
  for (std::size_t i = 0; i < 6; ++i) {
    CHECK(double(model.output_mean[15 + i]) == doctest::Approx(std::log(calibration.wrench[i])));
  }
}

TEST_CASE("touch score: what is called unexplained is told by the tail of many touches, not by the worst") {
  constexpr int kTouches = 5000;
  std::vector<TouchTrial> trials;
  for (int i = 0; i < kTouches; ++i) {
    trials.push_back(ramp(0, 5).front());
    trials.back().explained = static_cast<float>(std::log((i + 0.5) / kTouches));  // one in a thousand below log(0.001)
  }
  const auto limit = [&] { return double(calibrate(trials, 2).explained_above); };
  CHECK(limit() == doctest::Approx(std::log(0.001)).epsilon(0.02));
  for (int i = 0; i < kTouches / 500; ++i) trials[static_cast<std::size_t>(i)].explained = -40;  // one odd state of 500
  CHECK(limit() == doctest::Approx(std::log(0.001)).epsilon(0.02));
  for (int i = 0; i < kTouches / 500; ++i) {
    trials.push_back(ramp(0, 1).front());  // below the threshold of motion: it is not published anyway
    trials.back().explained = -40;
  }
  CHECK(limit() == doctest::Approx(std::log(0.001)).epsilon(0.02));
}

TEST_CASE("touch score: a factor makes radii hold 68 %, counted on the paths that it was not fitted to") {
  std::vector<TouchTrial> small = ramp(0, 5), large = ramp(1, 5);
  const double factor = radius_factor(small, 2);
  CHECK(radius_factor({}, 2) == 1);
  for (TouchTrial& trial : large) trial.error_mm *= 2;
  std::vector<TouchTrial> both = small;
  both.insert(both.end(), large.begin(), large.end());
  scale_cross_fitted(both, 2);
  CHECK(double(both.front().radius_68_mm) == doctest::Approx(2 * factor * double(small.front().radius_68_mm)));
  CHECK(double(both.back().radius_68_mm) == doctest::Approx(factor * double(large.back().radius_68_mm)));
  for (TouchTrial& trial : small) trial.radius_68_mm *= static_cast<float>(factor);
  CHECK(score(small, 2).coverage_68 == doctest::Approx(0.68).epsilon(0.02));
}

TEST_CASE("touch score: ignores trials below the threshold, and copes with no trials at all") {
  std::vector<TouchTrial> trials = ramp(0, 5);
  const TouchScore alone = score(trials, 2);
  const std::vector<TouchTrial> weak = ramp(1, 1.9f);
  trials.insert(trials.end(), weak.begin(), weak.end());
  CHECK(score(trials, 2).touches == 100);
  CHECK(score(trials, 2).mean_mm == alone.mean_mm);
  CHECK(score(weak, 2).touches == 0);
  CHECK(score(weak, 2).mean_mm == 0);
  CHECK(calibrate(weak, 2).radius_curve == TouchModelData{}.radius_curve);
}

TEST_CASE("touch score: in every band of plate motion the radius holds 68 % and twice the radius 95 %") {
  // Errors in the plane whose scale varies. The network's radius is wrong in each band in a different way, and follows
  // only half of the variation.
  Random random(3);
  std::vector<TouchTrial> trials;
  for (int i = 0; i < 40000; ++i) {
    TouchTrial trial;
    trial.path = i % 100;
    trial.plate_motion_mm = static_cast<float>(2 + 16 * random.uniform());
    const double known = 0.5 * random.normal(), unknown = 0.5 * random.normal();
    const double sigma_mm = 3 / static_cast<double>(trial.plate_motion_mm) * std::exp(known + unknown);
    trial.error_mm =
        Vec3f(static_cast<float>(sigma_mm * random.normal()), static_cast<float>(sigma_mm * random.normal()), 0);
    trial.radius_68_mm = static_cast<float>(std::exp(2 * known));
    trial.wrench_sigma.fill(1);
    trial.wrench_error.fill(1);
    trials.push_back(trial);
  }
  const std::vector<TouchBand> bands = error_bands(cross_calibrated(trials, 2));
  REQUIRE(bands.size() == 4);
  for (const TouchBand& band : bands) {
    CAPTURE(band.from_mm);
    CHECK(std::abs(band.coverage_68 - 0.68) < 0.015);
    CHECK(std::abs(band.coverage_95 - 0.95) < 0.03);
  }
}

TEST_CASE("touch score: figures of hand-made trials") {
  std::vector<TouchTrial> trials = ramp(0, 5);
  for (TouchTrial& trial : trials) {
    if (trial.error_mm.y() > 0.505f) trial.plate_motion_mm = 3;
  }
  const TouchScore result = score(trials, 2);
  CHECK(result.touches == 100);
  CHECK(result.mean_mm == doctest::Approx(0.505));
  CHECK(score(trials, 4).mean_mm == doctest::Approx(0.255));
  CHECK(result.rmse_mm[0] == 0);
  CHECK(result.rmse_mm[1] == doctest::Approx(std::sqrt(0.33835)).epsilon(1e-4));
  CHECK(result.r2[1] == doctest::Approx(1 - 0.33835 / 0.25).epsilon(1e-4));
  CHECK(result.r2[0] == 0);  // no variance to explain
  for (const double rmse : result.wrench_rmse) CHECK(rmse == doctest::Approx(2 * std::sqrt(0.33835)).epsilon(1e-4));
  for (const double inside : result.wrench_coverage_68) CHECK(inside == doctest::Approx(0.25).epsilon(0.05));
  CHECK(result.coverage_68 == doctest::Approx(0.2).epsilon(0.06));
  CHECK(result.coverage_95 == doctest::Approx(0.4).epsilon(0.03));
}

TEST_CASE("touch score: each half of the points is calibrated on the other half") {
  std::vector<TouchTrial> trials = ramp(3, 5);
  std::vector<TouchTrial> other = ramp(8, 5);
  for (TouchTrial& trial : other) trial.error_mm *= 2;  // twice as large as the network states
  trials.insert(trials.end(), other.begin(), other.end());
  // Path 3 is judged by a radius of 1.36 mm, path 8 (errors up to 2 mm) by one of 0.68 mm.
  const TouchScore judged = score(cross_calibrated(trials, 2), 2);
  CHECK(judged.coverage_68 == doctest::Approx((1.0 + 0.34) / 2).epsilon(0.02));
  CHECK(judged.coverage_95 == doctest::Approx((1.0 + 0.68) / 2).epsilon(0.02));
}

TEST_CASE("touch score: bands by plate motion and by force, and the curve of coverage") {
  std::vector<TouchTrial> trials = ramp(0, 5), weak = ramp(1, 1.5f);
  for (TouchTrial& trial : trials) trial.force_n = 2.5f;
  for (TouchTrial& trial : weak) trial.error_mm *= 3;
  trials.insert(trials.end(), weak.begin(), weak.end());
  const std::vector<TouchBand> bands = error_bands(trials);
  REQUIRE(bands.size() == 2);
  CHECK(bands[0].from_mm == 1);
  CHECK(bands[0].mean_mm == doctest::Approx(1.515));
  CHECK(bands[1].from_mm == 4);
  CHECK(bands[1].error_95_mm == doctest::Approx(0.95).epsilon(0.02));
  CHECK(bands[1].coverage_95 == doctest::Approx(0.4).epsilon(0.03));

  const std::vector<ForceBand> forces = force_bands(trials, 2);
  REQUIRE(forces.size() == 1);
  CHECK(forces[0].from_n == 2);
  CHECK(forces[0].touches == 100);
  CHECK(forces[0].bias_n == doctest::Approx(-1.01));
  CHECK(forces[0].coverage_68 == doctest::Approx(0.25).epsilon(0.05));

  const std::vector<double> curve = coverage_curve(trials, 2);
  CHECK(curve.size() == 30);
  CHECK(curve[9] == doctest::Approx(0.2).epsilon(0.06));
  CHECK(curve[29] == doctest::Approx(0.6).epsilon(0.03));
}

TEST_CASE("touch score: the cost of int8 is how far the point moves") {
  std::vector<TouchTrial> trials = ramp(0, 5);
  for (TouchTrial& trial : trials) trial.quantisation_mm = trial.error_mm.y() / 10, trial.float_error_mm = 0.5f;
  const Quantisation cost = quantisation_cost(trials, 2);
  CHECK(cost.mean_mm == doctest::Approx(0.0505));
  CHECK(cost.worst_mm == doctest::Approx(0.1));
  CHECK(cost.float_error_mm == doctest::Approx(0.5));
  CHECK(cost.int8_error_mm == doctest::Approx(0.505));
}
