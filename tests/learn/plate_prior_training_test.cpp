#include <doctest/doctest.h>

#include <Eigen/Eigenvalues>

#include "firmware/model/plate_prior.h"
#include "hostgen/learn/state_interpolant.h"
#include "hostgen/learn/touch_training.h"
#include "tests/learn/synthetic_finger.h"

using namespace finsight;
using namespace finsight::host;

namespace {

Eigen::MatrixXd covariance_of(const PlatePriorData& prior) {
  return Eigen::Map<const Eigen::Matrix<float, kPoseDims, kPoseDims>>(prior.covariance.data()).cast<double>();
}

}  // namespace

TEST_CASE("plate prior: mean and covariance of all states and their fractions, by brute force") {
  const FemDataset dataset = test::synthetic_dataset();
  const PlatePriorData prior = fit_plate_prior(dataset, test::synthetic_spec().noise);
  std::vector<Eigen::VectorXd> samples;
  for (const FemState& state : dataset.states) {
    for (const double fraction : {0.0, 0.25, 0.5, 0.75, 1.0}) {
      samples.push_back(fraction * touch_sample(state).numbers.cast<double>());
    }
  }
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(kPoseDims);
  for (const auto& sample : samples) mean += sample / double(samples.size());
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(kPoseDims, kPoseDims);
  for (const auto& sample : samples)
    covariance += (sample - mean) * (sample - mean).transpose() / double(samples.size());
  for (int i = 0; i < kPoseDims; ++i) covariance(i, i) += i % 6 < 3 ? 0.01 : 2.5e-5;
  CHECK((Eigen::Map<const PoseVector>(prior.mean.data()).cast<double>() - mean).norm() < 1e-5);
  CHECK((covariance_of(prior) - covariance).norm() < 1e-5 * covariance.norm());
}

TEST_CASE("plate prior: the covariance is symmetric and positive definite, even for a single state") {
  FemDataset dataset = test::synthetic_dataset();
  for (const std::size_t count : {dataset.states.size(), std::size_t{1}}) {
    dataset.states.resize(count);
    const Eigen::MatrixXd covariance = covariance_of(fit_plate_prior(dataset, test::synthetic_spec().noise));
    CHECK((covariance - covariance.transpose()).norm() == 0);
    CHECK(Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(covariance).eigenvalues().minCoeff() > 1e-5);
  }
}

TEST_CASE("plate prior: a missing plate of a touched finger is completed far better than by the mean") {
  const FemDataset dataset = test::synthetic_dataset();
  const PlatePriorData prior = fit_plate_prior(dataset, test::synthetic_spec().noise);
  double completed_sq = 0, mean_sq = 0;
  for (const FemState& state : dataset.states) {
    const PoseVector truth = touch_sample(state).numbers;
    PoseVector numbers = truth, nothing_seen = truth;
    complete_from_prior(prior.view(), {true, false, true}, numbers);
    complete_from_prior(prior.view(), {false, false, false}, nothing_seen);
    completed_sq += double((numbers - truth).squaredNorm());
    mean_sq += double((nothing_seen - truth).segment<6>(6).squaredNorm());
  }
  CHECK(completed_sq < 0.1 * mean_sq);
}

TEST_CASE("plate prior: ignores invalid states, and refuses a training set without valid ones") {
  FemDataset dataset = test::synthetic_dataset();
  const PlatePriorData expected = fit_plate_prior(dataset, test::synthetic_spec().noise);
  FemState broken = dataset.states[0];
  broken.outcome = Outcome::kPushedTooFar;
  broken.plates[1].rotation_rad.setConstant(1e9f);
  dataset.states.push_back(broken);
  CHECK(fit_plate_prior(dataset, test::synthetic_spec().noise).covariance == expected.covariance);
  dataset.states = {broken};
  CHECK_THROWS_AS(fit_plate_prior(dataset, test::synthetic_spec().noise), std::runtime_error);
}
