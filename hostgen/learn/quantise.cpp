// Rounding of the touch network to int8; declared in touch_network.h.
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "hostgen/learn/touch_network.h"

namespace finsight::host {

namespace {

constexpr double kLargest = 127.0;

// Rounds one layer column by column. The columns that are not rounded yet compensate the error of rounding each column,
// in the least-squares sense over the samples that reach the layer (GPTQ, Frantar et al. 2022, arXiv 2210.17323). The
// samples lie near a surface of few dimensions, so nearly all of the error can be compensated.
struct RoundedLayer {
  Eigen::MatrixXf weights;  ///< whole numbers
  Eigen::VectorXf scale;    ///< per output
};
RoundedLayer round_layer(const Eigen::MatrixXf& weights, const Eigen::MatrixXf& samples) {
  constexpr double kDamping = 1e-3;  // of the mean size of an input: keeps the compensation small
  Eigen::MatrixXd hessian = samples.cast<double>() * samples.cast<double>().transpose();
  hessian.diagonal().array() += kDamping * std::max(hessian.diagonal().mean(), 1e-12);
  const Eigen::MatrixXd inverse = hessian.llt().solve(Eigen::MatrixXd::Identity(hessian.rows(), hessian.cols()));
  const Eigen::MatrixXd upper = inverse.llt().matrixU();

  RoundedLayer rounded{Eigen::MatrixXf(weights.rows(), weights.cols()),
                       weights.cwiseAbs().rowwise().maxCoeff() / kLargest};
  for (float& scale : rounded.scale) scale = scale > 0 ? scale : 1.0f;
  Eigen::MatrixXd rest = weights.cast<double>();
  for (Eigen::Index i = 0; i < rest.cols(); ++i) {
    for (Eigen::Index o = 0; o < rest.rows(); ++o) {
      const double steps = rest(o, i) / static_cast<double>(rounded.scale[o]);
      rounded.weights(o, i) = static_cast<float>(std::clamp(std::round(steps), -kLargest, kLargest));
    }
    const Eigen::VectorXd error =
        (rest.col(i) - rounded.weights.col(i).cwiseProduct(rounded.scale).cast<double>()) / upper(i, i);
    const Eigen::Index left = rest.cols() - i - 1;
    rest.rightCols(left).noalias() -= error * upper.row(i).tail(left);
  }
  return rounded;
}

template <class Number>
std::vector<Number> row_major(const Eigen::MatrixXf& weights) {
  std::vector<Number> numbers;
  for (Eigen::Index o = 0; o < weights.rows(); ++o) {
    for (Eigen::Index i = 0; i < weights.cols(); ++i) numbers.push_back(static_cast<Number>(weights(o, i)));
  }
  return numbers;
}

}  // namespace

LayerData float_layer(const Network::Layer& layer) {
  return {static_cast<int>(layer.weights.cols()),
          static_cast<int>(layer.weights.rows()),
          row_major<float>(layer.weights),
          {layer.bias.begin(), layer.bias.end()}};
}

void quantise(TouchNetwork& trained) {
  TouchModelData& model = trained.model;
  const Network::Layer &first = trained.network.layers().front(), &last = trained.network.layers().back();
  model.first = float_layer(first);
  Eigen::MatrixXf exact = (first.weights * trained.sample_inputs).colwise() + first.bias;
  activate(Activation::kAlgebraicSilu, exact);
  Eigen::MatrixXf seen = exact;  // what reaches the float layer and the rounded one
  for (std::size_t l = 0; l < TouchModel::kRounded; ++l) {
    const Network::Layer& layer = trained.network.layers()[l + 1];
    const RoundedLayer rounded = round_layer(layer.weights, seen);
    const Eigen::MatrixXf exact_sums = layer.weights * exact;
    const Eigen::MatrixXf sums = rounded.scale.asDiagonal() * (rounded.weights * seen);
    const Eigen::VectorXf bias = layer.bias + (exact_sums - sums).rowwise().mean();

    model.weights[l] = row_major<std::int8_t>(rounded.weights);
    model.weight_scale[l].assign(rounded.scale.begin(), rounded.scale.end());
    model.bias[l].assign(bias.begin(), bias.end());
    exact = exact_sums.colwise() + layer.bias;
    seen = sums.colwise() + bias;
    activate(Activation::kAlgebraicSilu, exact);
    activate(Activation::kAlgebraicSilu, seen);
  }
  model.last = float_layer({last.weights, last.bias + last.weights * (exact - seen).rowwise().mean()});
}

}  // namespace finsight::host
