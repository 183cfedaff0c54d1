// The paper's network: plate numbers in, touched point out, both z-scored; no uncertainty.
#pragma once

#include <functional>

#include "hostgen/learn/network.h"

namespace finsight::host {

struct RegressionPlan {
  std::vector<int> hidden = {512, 256};  ///< the paper's
  int steps = 20000;                     ///< Adam steps
  int batch = 128;
  float peak_rate = 1e-3f;
  std::uint64_t seed = 1;
};

class Regression {
 public:
  /// inputs: [numbers, samples], targets: [outputs, samples], mean squared error of the z-scored targets. `tick` is
  /// called after every step; it may throw to stop. Same arguments, same bytes.
  Regression(const Eigen::MatrixXf& inputs, const Eigen::MatrixXf& targets, const RegressionPlan& plan,
             const std::function<void()>& tick);

  /// [outputs, samples]
  Eigen::MatrixXf predict(const Eigen::MatrixXf& inputs);

 private:
  Eigen::VectorXf input_mean_, input_scale_, output_mean_, output_scale_;
  Network network_;
};

}  // namespace finsight::host
