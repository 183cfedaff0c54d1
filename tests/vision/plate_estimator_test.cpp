#include "firmware/vision/plate_estimator.h"

#include <doctest/doctest.h>

#include "firmware/input_error.h"
#include "firmware/model/plate_prior.h"
#include "tests/vision/test_finger.h"

using namespace finsight;
using namespace finsight::test;

namespace {

constexpr double kFocalPx = 490;

/// The camera's view of plates that moved by `numbers`, with corner noise of `noise_px`.
PlateSight sight_of(const PoseVectord& numbers, const std::array<bool, kPlates>& seen, double noise_px,
                    Random& random) {
  const MountModel mount = test_mount();
  PlateSight sight;
  sight.seen = seen;
  for (std::size_t p = 0; p < kPlates; ++p) {
    const PaintedMarker marker = moved_marker(mount, plate_motions(numbers)[p], p);
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d corner = marker.T_camera_marker * finsight::marker_corner(mount.marker_size_mm, k);
      const Eigen::Vector2d noise(random.normal(), random.normal());
      sight.rays[p][k] = corner.head<2>() / corner.z() + noise_px / kFocalPx * noise;
    }
  }
  return sight;
}

}  // namespace

TEST_CASE("plates: recovers the motion that gave a marker its pose") {
  const TestPrior prior;
  const PlateEstimator estimator(test_mount(), prior.view(), kFocalPx);
  Random random(1);
  for (int i = 0; i < 50; ++i) {
    const PoseVectord numbers = prior.draw(random, 2);
    for (std::size_t p = 0; p < kPlates; ++p) {
      const PaintedMarker marker = moved_marker(test_mount(), plate_motions(numbers)[p], p);
      const Eigen::Matrix<double, 6, 1> expected = numbers.segment<6>(6 * static_cast<int>(p));
      CHECK((estimator.motion(p, marker.T_camera_marker) - expected).cwiseAbs().maxCoeff() < 1e-4);
    }
  }
}

TEST_CASE("plates: ten steps from far away reach the minimum of the cost, by finite differences") {
  const TestPrior prior;
  const PlateEstimator estimator(test_mount(), prior.view(), kFocalPx);
  Random random(2);
  for (int i = 0; i < 20; ++i) {
    PlateSight sight = sight_of(prior.draw(random), {true, true, true}, 0.1, random);
    sight.corner_sigma_px = 0.1;
    PoseVectord numbers = estimator.prior_mean();
    for (int step = 0; step < 10; ++step) estimator.gauss_newton_step(sight, numbers);
    const double least = estimator.cost(sight, numbers);
    for (int n = 0; n < kPoseDims; ++n) {
      const double h = n % 6 < 3 ? 1e-4 : 1e-5;
      PoseVectord up = numbers, down = numbers;
      up[n] += h;
      down[n] -= h;
      const double cost_up = estimator.cost(sight, up), cost_down = estimator.cost(sight, down);
      const double slope = (cost_up - cost_down) / (2 * h), curvature = (cost_up - 2 * least + cost_down) / (h * h);
      CHECK(curvature > 0);
      CHECK(std::abs(slope / curvature) < 1e-4 * (n % 6 < 3 ? 1 : 0.1));
    }
  }
}

TEST_CASE("plates: noise-free corners are reproduced for all motions of the prior") {
  const TestPrior prior;
  const PlateEstimator estimator(test_mount(), prior.view(), kFocalPx);
  Random random(3);
  for (int i = 0; i < 50; ++i) {
    const PoseVectord truth = prior.draw(random);
    const PlateSight sight = sight_of(truth, {true, true, true}, 0, random);
    PoseVectord numbers = estimator.prior_mean();
    for (int step = 0; step < 6; ++step) estimator.gauss_newton_step(sight, numbers);
    for (std::size_t p = 0; p < kPlates; ++p) CHECK(estimator.reprojection_px(sight, p, numbers) < 0.05);
    CHECK(estimator.cost(sight, numbers) <= estimator.cost(sight, truth) + 1e-9);
  }
}

TEST_CASE("plates: estimates the corners' scatter from the residuals") {
  const TestPrior prior;
  const PlateEstimator estimator(test_mount(), prior.view(), kFocalPx);
  Random random(6);
  for (const double noise_px : {0.02, 0.05, 0.1, 0.3}) {
    double sum_sq = 0;
    for (int i = 0; i < 200; ++i) {
      const PoseVectord truth = prior.draw(random);
      PlateSight sight = sight_of(truth, {true, true, true}, noise_px, random);
      estimator.estimate(sight, truth, 6);
      sum_sq += sight.corner_sigma_px * sight.corner_sigma_px / 200;
    }
    // A prior guess of weight 4 beside the 6 residuals of three markers that no motion explains.
    const double expected_px = std::sqrt((4 * 0.05 * 0.05 + 6 * noise_px * noise_px) / 10);
    CHECK(std::sqrt(sum_sq) == doctest::Approx(expected_px).epsilon(0.1));
  }
}

TEST_CASE("plates: the stated noise equals the actual error, also with fewer plates and worse corners") {
  const TestPrior prior;
  const PlateEstimator estimator(test_mount(), prior.view(), kFocalPx);
  const auto sigma = prior.view().noise;
  Random random(7);
  for (const double noise_px : {0.05, 0.2}) {
    for (const std::array<bool, kPlates>& seen : {std::array{true, true, true}, std::array{true, false, true}}) {
      std::array<double, kPlates> error_sq{}, noise_sq{};
      for (int i = 0; i < 300; ++i) {
        const PoseVectord truth = prior.draw(random);
        PlateSight sight = sight_of(truth, seen, noise_px, random);
        const PoseVectord found = estimator.estimate(sight, truth, 6);
        const std::array<float, kPlates> noise = estimator.noise(sight, found);
        for (int n = 0; n < kPoseDims; ++n) {
          const auto k = static_cast<std::size_t>(n);
          error_sq[k / 6] += std::pow((found[n] - truth[n]) / static_cast<double>(sigma[k]), 2) / 6;
        }
        for (std::size_t p = 0; p < kPlates; ++p) noise_sq[p] += std::pow(static_cast<double>(noise[p]), 2);
      }
      for (std::size_t p = 0; p < kPlates; ++p) {
        INFO(noise_px, " px, plate ", p, " seen ", seen[p]);
        CHECK(std::sqrt(noise_sq[p] / error_sq[p]) == doctest::Approx(1).epsilon(0.25));
      }
    }
  }
}

namespace {

/// How a finger rests whose markers look `further` times as far from the camera, because they were printed smaller.
ZeroPose small_print(float further) {
  ZeroPose rest{};
  const MountModel mount = test_mount();
  for (std::size_t p = 0; p < kPlates; ++p) {
    rest[p].displacement_mm =
        (further - 1) * (mount.T_finger_marker[p].translation() - mount.T_finger_camera.translation());
  }
  return rest;
}

PoseVectord numbers_of(const ZeroPose& rest) {
  PoseVectord numbers;
  for (int p = 0; p < kPlates; ++p) {
    const PlateMotion& plate = rest[static_cast<std::size_t>(p)];
    numbers.segment<6>(6 * p) << plate.displacement_mm.cast<double>(), plate.rotation_rad.cast<double>();
  }
  return numbers;
}

/// Of a plate's six numbers the places, RMS.
double place_error_mm(const PoseVectord& found, const PoseVectord& truth) {
  double sum_sq = 0;
  for (int p = 0; p < kPlates; ++p) sum_sq += (found - truth).segment<3>(6 * p).squaredNorm() / kPlates;
  return std::sqrt(sum_sq);
}

}  // namespace

TEST_CASE("plates: a finger that rests elsewhere is found there, not pulled towards the pack's touches") {
  const TestPrior prior;
  const PlateEstimator estimator(test_mount(), prior.view(), kFocalPx);
  Random random(9);
  double pulled_sq = 0, at_rest_sq = 0;
  constexpr int kTimes = 100;
  const PoseVectord truth = numbers_of(small_print(1.015F));
  for (int i = 0; i < kTimes; ++i) {
    PlateSight sight = sight_of(truth, {true, true, true}, 0.05, random);
    const PoseVectord pulled = estimator.estimate(sight, truth, 6);
    pulled_sq += std::pow(place_error_mm(pulled, truth), 2) / kTimes;
    at_rest_sq += std::pow(place_error_mm(estimator.estimate_at_rest(sight, pulled), truth), 2) / kTimes;
  }
  INFO(std::sqrt(pulled_sq), " and ", std::sqrt(at_rest_sq), " mm");
  CHECK(std::sqrt(at_rest_sq) < 0.7 * std::sqrt(pulled_sq));
}

TEST_CASE("plates: motions of a finger that rests elsewhere are as probable as those of one that rests as the model") {
  const TestPrior prior;
  PlateEstimator estimator(test_mount(), prior.view(), kFocalPx);
  Random random(10);
  const ZeroPose rest = small_print(1.015F);
  double before_sq = 0, after_sq = 0;
  constexpr int kTimes = 100;
  for (int i = 0; i < kTimes; ++i) {
    const PoseVectord truth = prior.draw(random) + numbers_of(rest);
    PlateSight sight = sight_of(truth, {true, true, true}, 0.05, random);
    estimator.set_rest({});
    before_sq += std::pow(place_error_mm(estimator.estimate(sight, truth, 6), truth), 2) / kTimes;
    estimator.set_rest(rest);
    after_sq += std::pow(place_error_mm(estimator.estimate(sight, truth, 6), truth), 2) / kTimes;
  }
  INFO(std::sqrt(before_sq), " and ", std::sqrt(after_sq), " mm");
  CHECK(std::sqrt(after_sq) < 0.7 * std::sqrt(before_sq));
}

TEST_CASE("plates: an outlying corner moves its plate little") {
  const TestPrior prior;
  const PlateEstimator estimator(test_mount(), prior.view(), kFocalPx);
  Random random(8);
  double worst_mm = 0;
  for (int i = 0; i < 50; ++i) {
    const PoseVectord truth = prior.draw(random);
    PlateSight sight = sight_of(truth, {true, true, true}, 0.02, random);
    sight.rays[1][2] += Eigen::Vector2d(2, -1) / kFocalPx;
    const PoseVectord found = estimator.estimate(sight, truth, 6);
    worst_mm = std::max(worst_mm, (found - truth).segment<3>(6).norm());
  }
  CHECK(worst_mm < 0.3);  // least squares: 1.0 mm
}

TEST_CASE("plates: unseen ones get their conditional mean given the seen ones") {
  const TestPrior prior;
  const PlateEstimator estimator(test_mount(), prior.view(), kFocalPx);
  Random random(4);
  for (unsigned mask = 0; mask < 8; ++mask) {
    const std::array<bool, kPlates> seen{(mask & 1) != 0, (mask & 2) != 0, (mask & 4) != 0};
    const PlateSight sight = sight_of(prior.draw(random), seen, 0.05, random);
    PoseVectord numbers = estimator.prior_mean();
    for (int step = 0; step < 6; ++step) estimator.gauss_newton_step(sight, numbers);
    PoseVector expected = numbers.cast<float>();
    complete_from_prior(prior.view(), seen, expected);
    CHECK((numbers.cast<float>() - expected).cwiseAbs().maxCoeff() < 2e-3F);
  }
}

TEST_CASE("plates: behind the camera the cost is infinite, and the estimate stays finite") {
  const TestPrior prior;
  const PlateEstimator estimator(test_mount(), prior.view(), kFocalPx);
  Random random(5);
  const PlateSight sight = sight_of(PoseVectord::Zero(), {true, true, true}, 0, random);
  PoseVectord numbers = PoseVectord::Zero();
  numbers[1] = -200;
  CHECK(std::isinf(estimator.cost(sight, numbers)));
  CHECK(std::isinf(estimator.reprojection_px(sight, 0, numbers)));
  estimator.gauss_newton_step(sight, numbers);
  CHECK(numbers.allFinite());
  numbers[7] = std::nan("");
  CHECK(std::isinf(estimator.reprojection_px(sight, 1, numbers)));
}

TEST_CASE("plates: refuses a prior that is not a Gaussian") {
  const TestPrior good;
  const std::vector<float> mean(good.view().mean.begin(), good.view().mean.end());
  const std::vector<float> covariance(good.view().covariance.begin(), good.view().covariance.end());
  const auto refused = [&good](const std::vector<float>& m, const std::vector<float>& c) {
    CHECK_THROWS_AS(PlateEstimator(test_mount(), PlatePrior{m, c, good.view().noise}, kFocalPx), InputError);
  };
  refused({}, {});
  refused(mean, std::vector<float>(kPoseDims, 1));
  std::vector<float> wrong = covariance;
  wrong[19] = -1;
  refused(mean, wrong);
  wrong = covariance;
  wrong[19] = std::nanf("");
  refused(mean, wrong);
  std::vector<float> nowhere = mean;
  nowhere[3] = std::nanf("");
  refused(nowhere, covariance);
}
