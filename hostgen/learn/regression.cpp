#include "hostgen/learn/regression.h"

namespace finsight::host {

namespace {

Eigen::VectorXf spread(const Eigen::MatrixXf& rows, const Eigen::VectorXf& mean) {
  constexpr float kConstant = 1e-6f;  // a row that varies less is not scaled
  const Eigen::ArrayXf sigma = (rows.colwise() - mean).array().square().rowwise().mean().sqrt();
  return (sigma > kConstant).select(sigma, 1.0f);
}

std::vector<int> widths(Eigen::Index inputs, const std::vector<int>& hidden, Eigen::Index outputs) {
  std::vector<int> all = {static_cast<int>(inputs)};
  all.insert(all.end(), hidden.begin(), hidden.end());
  all.push_back(static_cast<int>(outputs));
  return all;
}

Network start(const std::vector<int>& widths, std::uint64_t seed) {
  Random random(seed);
  return {widths, Activation::kRelu, random};
}

}  // namespace

Regression::Regression(const Eigen::MatrixXf& inputs, const Eigen::MatrixXf& targets, const RegressionPlan& plan,
                       const std::function<void()>& tick)
    : input_mean_(inputs.rowwise().mean()),
      input_scale_(spread(inputs, input_mean_)),
      output_mean_(targets.rowwise().mean()),
      output_scale_(spread(targets, output_mean_)),
      network_(start(widths(inputs.rows(), plan.hidden, targets.rows()), plan.seed)) {
  Adam adam(network_);
  Random random(plan.seed + 1);
  Eigen::MatrixXf x(inputs.rows(), plan.batch), y(targets.rows(), plan.batch), gradient;
  for (int step = 0; step < plan.steps; ++step) {
    for (int column = 0; column < plan.batch; ++column) {
      const auto sample = static_cast<Eigen::Index>(random.index(static_cast<std::size_t>(inputs.cols())));
      x.col(column) = (inputs.col(sample) - input_mean_).cwiseQuotient(input_scale_);
      y.col(column) = (targets.col(sample) - output_mean_).cwiseQuotient(output_scale_);
    }
    gradient = (network_.forward(x) - y) / static_cast<float>(plan.batch);
    network_.backward(gradient);
    adam.step(network_, cosine_rate(plan.peak_rate, step, plan.steps));
    tick();
  }
}

Eigen::MatrixXf Regression::predict(const Eigen::MatrixXf& inputs) {
  const Eigen::MatrixXf x = ((inputs.colwise() - input_mean_).array().colwise() / input_scale_.array()).matrix();
  const Eigen::MatrixXf y = (network_.forward(x).array().colwise() * output_scale_.array()).matrix();
  return y.colwise() + output_mean_;
}

}  // namespace finsight::host
