// The Gaussian over plate motions; declared in touch_training.h.
#include <Eigen/Core>

#include "hostgen/learn/state_interpolant.h"
#include "hostgen/learn/touch_training.h"

namespace finsight::host {

namespace {

// A finger on its way from rest passes all smaller loads, so every state also counts at these fractions of itself.
constexpr double kFractions[] = {0.0, 0.25, 0.5, 0.75, 1.0};
// The prior describes measured motions. This much measurement noise makes the covariance positive definite (the states
// lie near a three-dimensional surface) and keeps the completion of unseen plates from amplifying noise.
constexpr double kNoise_mm = 0.1, kNoise_rad = 0.005;

using PoseMatrix = Eigen::Matrix<double, kPoseDims, kPoseDims>;

}  // namespace

PlatePrior PlatePriorData::view() const { return {mean, covariance, noise}; }

PlatePriorData fit_plate_prior(const FemDataset& dataset, const std::array<PoseNoise, kPlates>& noise) {
  PoseVectorOf<double> sum = PoseVectorOf<double>::Zero();
  PoseMatrix squares = PoseMatrix::Zero();
  double count = 0;
  for (const FemState& state : dataset.states) {
    if (!state.valid()) continue;
    const PoseVectorOf<double> numbers = touch_sample(state).numbers.cast<double>();
    for (const double fraction : kFractions) {
      sum += fraction * numbers;
      squares += fraction * fraction * numbers * numbers.transpose();
      count += 1;
    }
  }
  if (count == 0) throw std::runtime_error("training set: no valid state, so no prior over the plate motions");
  const PoseVectorOf<double> mean = sum / count;
  PoseMatrix covariance = squares / count - mean * mean.transpose();
  for (int i = 0; i < kPoseDims; ++i) covariance(i, i) += i % 6 < 3 ? kNoise_mm * kNoise_mm : kNoise_rad * kNoise_rad;

  PlatePriorData prior;
  for (int i = 0; i < kPoseDims; ++i) prior.mean.push_back(static_cast<float>(mean[i]));
  for (const double value : covariance.reshaped()) prior.covariance.push_back(static_cast<float>(value));
  for (const double sigma : pose_noise(noise)) prior.noise.push_back(static_cast<float>(sigma));
  return prior;
}

}  // namespace finsight::host
