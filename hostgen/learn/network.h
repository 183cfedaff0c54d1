// A small multilayer perceptron and its Adam trainer, on Eigen.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "hostgen/util/random.h"

namespace finsight::host {

/// What hidden layers do to their sums.
enum class Activation {
  kRelu,           ///< the paper's
  kAlgebraicSilu,  ///< firmware/touch/int8_network.h's algebraic_silu()
};

/// Dense layers with an activation between them and none after the last. Samples are columns.
class Network {
 public:
  struct Layer {
    Eigen::MatrixXf weights;  ///< [outputs, inputs]
    Eigen::VectorXf bias;     ///< [outputs]
  };

  /// `widths`: inputs, hidden ..., outputs. Normal weights of variance 2 / inputs (He et al. 2015), biases 0.
  Network(const std::vector<int>& widths, Activation activation, Random& random);

  /// [outputs, samples]. Keeps the activations for backward().
  const Eigen::MatrixXf& forward(const Eigen::Ref<const Eigen::MatrixXf>& inputs);
  /// `loss_by_output`: derivative of the loss by every output of the last forward(). Fills gradients().
  void backward(const Eigen::Ref<const Eigen::MatrixXf>& loss_by_output);

  std::vector<Layer>& layers() { return layers_; }
  const std::vector<Layer>& layers() const { return layers_; }
  const std::vector<Layer>& gradients() const { return gradients_; }

 private:
  Activation activation_;
  std::vector<Layer> layers_, gradients_;
  std::vector<Eigen::MatrixXf> activations_;  // inputs, after each layer
  std::vector<Eigen::MatrixXf> derivatives_;  // of the activation, after each hidden layer
  Eigen::MatrixXf slope_, next_slope_;        // derivative of the loss by one layer's sums
};

/// Applies the activation to a layer's sums; `derivative`, unless null, gets its derivative there.
void activate(Activation activation, Eigen::MatrixXf& sums, Eigen::MatrixXf* derivative = nullptr);

/// Adam (Kingma & Ba 2015) with its usual constants 0.9, 0.999, 1e-8. A step is as much smaller as the gradient of a
/// layer exceeds what came before (Wortsman et al. 2023, arXiv 2304.13013): one odd batch cannot throw a deep network
/// off its course.
class Adam {
 public:
  explicit Adam(const Network& network);
  void step(Network& network, float rate);

 private:
  std::vector<Network::Layer> mean_, square_;
  int steps_ = 0;
};

/// Learning rate that falls from `peak` to 0 along half a cosine, after a linear rise over the first 2 % of the steps.
float cosine_rate(float peak, int step, int steps);

}  // namespace finsight::host
