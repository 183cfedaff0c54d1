#include "hostgen/learn/network.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace finsight::host {

namespace {

std::vector<Network::Layer> zeros_like(const std::vector<Network::Layer>& layers) {
  std::vector<Network::Layer> zeros;
  for (const Network::Layer& layer : layers) {
    zeros.push_back(
        {Eigen::MatrixXf::Zero(layer.weights.rows(), layer.weights.cols()), Eigen::VectorXf::Zero(layer.bias.size())});
  }
  return zeros;
}

}  // namespace

// With r = x / sqrt(1 + x^2) the algebraic SiLU is x / 2 (1 + r), its derivative 1/2 + r - r^3 / 2.
void activate(Activation activation, Eigen::MatrixXf& sums, Eigen::MatrixXf* derivative) {
  if (activation == Activation::kRelu) {
    if (derivative) *derivative = (sums.array() > 0.0F).cast<float>();
    sums = sums.cwiseMax(0.0F);
    return;
  }
  const Eigen::ArrayXXf r = sums.array() / (1 + sums.array().square()).sqrt();
  if (derivative) *derivative = 0.5F + r - 0.5F * r.cube();
  sums = 0.5F * sums.array() * (1 + r);
}

Network::Network(const std::vector<int>& widths, Activation activation, Random& random) : activation_(activation) {
  for (std::size_t l = 0; l + 1 < widths.size(); ++l) {
    Layer layer{Eigen::MatrixXf(widths[l + 1], widths[l]), Eigen::VectorXf::Zero(widths[l + 1])};
    const double sigma = std::sqrt(2.0 / widths[l]);
    for (float& weight : layer.weights.reshaped()) weight = static_cast<float>(sigma * random.normal());
    layers_.push_back(std::move(layer));
  }
  gradients_ = zeros_like(layers_);
  activations_.resize(widths.size());
  derivatives_.resize(widths.size());
}

const Eigen::MatrixXf& Network::forward(const Eigen::Ref<const Eigen::MatrixXf>& inputs) {
  activations_[0] = inputs;
  for (std::size_t l = 0; l < layers_.size(); ++l) {
    Eigen::MatrixXf& sums = activations_[l + 1];
    sums.resize(layers_[l].weights.rows(), inputs.cols());
    sums.noalias() = layers_[l].weights * activations_[l];
    sums.colwise() += layers_[l].bias;
    if (l + 1 < layers_.size()) activate(activation_, sums, &derivatives_[l + 1]);
  }
  return activations_.back();
}

void Network::backward(const Eigen::Ref<const Eigen::MatrixXf>& loss_by_output) {
  slope_ = loss_by_output;
  for (std::size_t l = layers_.size(); l-- > 0;) {
    gradients_[l].weights.noalias() = slope_ * activations_[l].transpose();
    gradients_[l].bias = slope_.rowwise().sum();
    if (l == 0) break;
    next_slope_.resize(layers_[l].weights.cols(), slope_.cols());
    next_slope_.noalias() = layers_[l].weights.transpose() * slope_;
    slope_ = next_slope_.cwiseProduct(derivatives_[l]);
  }
}

Adam::Adam(const Network& network) : mean_(zeros_like(network.layers())), square_(mean_) {}

void Adam::step(Network& network, float rate) {
  constexpr float kMeanDecay = 0.9f, kSquareDecay = 0.999f, kEpsilon = 1e-8f;
  // The moments of weights that no longer receive a gradient would decay into denormal numbers, which are very slow.
  constexpr float kFloor = 1e-30f;
  ++steps_;
  const auto steps = static_cast<float>(steps_);
  const float mean_scale = 1.0f / (1.0f - std::pow(kMeanDecay, steps));
  const float square_scale = 1.0f / (1.0f - std::pow(kSquareDecay, steps));
  const auto update = [&](auto parameter, auto mean, auto square, auto gradient) {
    mean = kMeanDecay * mean + (1.0f - kMeanDecay) * gradient + kFloor;
    square = kSquareDecay * square + (1.0f - kSquareDecay) * gradient.square() + kFloor;
    const float excess = std::sqrt((gradient.square() / (square_scale * square).max(kEpsilon * kEpsilon)).mean());
    const float step = rate * mean_scale / std::max(1.0f, excess);
    parameter -= step * mean / ((square_scale * square).sqrt() + kEpsilon);
  };
  for (std::size_t l = 0; l < mean_.size(); ++l) {
    Network::Layer& layer = network.layers()[l];
    const Network::Layer& gradient = network.gradients()[l];
    update(layer.weights.array(), mean_[l].weights.array(), square_[l].weights.array(), gradient.weights.array());
    update(layer.bias.array(), mean_[l].bias.array(), square_[l].bias.array(), gradient.bias.array());
  }
}

float cosine_rate(float peak, int step, int steps) {
  const double done = static_cast<double>(step) / steps;
  const double rise = std::min(1.0, done / 0.02 + 1.0 / steps);
  return peak * static_cast<float>(rise * 0.5 * (1.0 + std::cos(std::numbers::pi * done)));
}

}  // namespace finsight::host
