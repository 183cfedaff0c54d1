#include "firmware/model/plate_prior.h"

#include <doctest/doctest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>
#include <vector>

using namespace finsight;

namespace {

// A covariance with the spread of sizes of millimetres and radians, and strong correlations.
struct TestPrior {
  std::vector<float> mean, covariance;
  TestPrior() {
    Eigen::Matrix<double, kPoseDims, kPoseDims> factor;
    for (int i = 0; i < kPoseDims; ++i) {
      for (int j = 0; j < kPoseDims; ++j)
        factor(i, j) = std::sin(1.7 * i + 0.9 * j * j) * (i % 6 < 3 ? 4 : 0.1) / (1 + j);
    }
    Eigen::Matrix<double, kPoseDims, kPoseDims> dense = factor * factor.transpose();
    for (int i = 0; i < kPoseDims; ++i) dense(i, i) += i % 6 < 3 ? 0.01 : 2.5e-5;
    for (const double value : dense.reshaped()) covariance.push_back(float(value));
    for (int i = 0; i < kPoseDims; ++i) mean.push_back(float(std::cos(i)));
  }
  PlatePrior view() const { return {mean, covariance, {}}; }
};

// The textbook formula, with a dense factorisation.
Eigen::VectorXd conditional_mean(const TestPrior& prior, const std::array<bool, 3>& seen, const PoseVector& numbers) {
  std::vector<int> known, unknown;
  for (int i = 0; i < kPoseDims; ++i) (seen[std::size_t(i / 6)] ? known : unknown).push_back(i);
  const Eigen::MatrixXd covariance =
      Eigen::Map<const Eigen::Matrix<float, kPoseDims, kPoseDims>>(prior.covariance.data()).cast<double>();
  const Eigen::VectorXd mean = Eigen::Map<const PoseVector>(prior.mean.data()).cast<double>();
  Eigen::VectorXd result = numbers.cast<double>();
  const Eigen::VectorXd deviation = (numbers.cast<double>() - mean)(known);
  result(unknown) =
      mean(unknown) + covariance(unknown, known) * Eigen::MatrixXd(covariance(known, known)).llt().solve(deviation);
  return result;
}

PoseVector some_numbers() {
  PoseVector numbers;
  for (int i = 0; i < kPoseDims; ++i) numbers[i] = std::sin(3.0f * float(i)) * (i % 6 < 3 ? 5.0f : 0.1f);
  return numbers;
}

}  // namespace

TEST_CASE("plate prior: completion equals the dense conditional mean for every set of seen plates") {
  const TestPrior prior;
  for (int mask = 1; mask < 8; ++mask) {
    const std::array<bool, 3> seen = {(mask & 1) != 0, (mask & 2) != 0, (mask & 4) != 0};
    const PoseVector given = some_numbers();
    PoseVector numbers = given;
    complete_from_prior(prior.view(), seen, numbers);
    const Eigen::VectorXd expected = conditional_mean(prior, seen, given);
    CHECK((numbers.cast<double>() - expected).norm() < 1e-5 * (1 + expected.norm()));
    for (int p = 0; p < 3; ++p) {
      if (seen[std::size_t(p)]) CHECK(numbers.segment<6>(6 * p) == given.segment<6>(6 * p));
    }
  }
}

TEST_CASE("plate prior: with no plate seen gives the mean") {
  const TestPrior prior;
  PoseVector numbers = some_numbers();
  complete_from_prior(prior.view(), {false, false, false}, numbers);
  CHECK(numbers == Eigen::Map<const PoseVector>(prior.mean.data()));
}

TEST_CASE("plate prior: previous values of unseen plates do not matter, and other fields of the poses stay") {
  const TestPrior prior;
  PlatePoses poses;
  poses.seen = {true, false, true};
  poses.quality = Quality::kFresh;
  poses.plates[0].displacement_mm = Vec3f(1, 2, 3);
  poses.plates[2].rotation_rad = Vec3f(0.1f, 0.2f, -0.1f);
  PlatePoses spoiled = poses;
  spoiled.plates[1].displacement_mm.setConstant(std::numeric_limits<float>::quiet_NaN());
  spoiled.plates[1].rotation_rad.setConstant(std::numeric_limits<float>::infinity());
  complete_from_prior(prior.view(), poses);
  complete_from_prior(prior.view(), spoiled);
  CHECK(pose_vector(poses) == pose_vector(spoiled));
  CHECK(poses.plates[0].displacement_mm == Vec3f(1, 2, 3));
  CHECK(poses.plates[1].displacement_mm.norm() > 0);
  CHECK(poses.seen == std::array<bool, 3>{true, false, true});
  CHECK(poses.quality == Quality::kFresh);
}
