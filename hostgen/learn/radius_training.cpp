#include "hostgen/learn/radius_training.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "firmware/touch/radius_network.h"
#include "hostgen/fem/scene_contacts.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

constexpr int kFitSteps = 2000;
constexpr float kFitRate = 0.02F, kFitDecay = 0.1F;
constexpr float kSmooth = 0.15F;  // width of the steps, in the logarithm of the radius

// What is wanted of the errors of every kind, and how much it counts.
constexpr float kInside = 0.68F, kInsideTwice = 0.95F;
constexpr float kOnceWeight = 5, kTwiceWeight = 12, kBeyondWeight = 100, kOthersWeight = 2;

/// Of trials: those of the scene, all of them where gravity is not known, and other scenes.
constexpr std::size_t kTurned = kKindsOfTouch, kFirstOther = kTurned + 1;

std::size_t kind_of(const TouchTrial& trial) {
  const std::size_t kind = trial.scene - kFirstKept;
  if (kind >= kKindsOfTouch) return kFirstOther + kind - kKindsOfTouch;
  return trial.gravity_is_known ? kind : kTurned;
}

struct Samples {
  Eigen::MatrixXf inputs;    ///< [TouchModel::kRadiusFeatures, samples] normalised
  Eigen::ArrayXf log_radii;  ///< logarithm of the error in radii
  std::vector<std::size_t> kind;
  std::vector<float> trials;  ///< of each kind
};

float sigmoid(float x) { return 1 / (1 + std::exp(std::clamp(-x, -30.0F, 30.0F))); }

/// Which part of each kind's errors lies inside `radii` when radii are widened by `answers`; and for every sample the
/// derivative of its kind's share by its answer.
std::vector<float> shares_inside(const Samples& samples, const Eigen::ArrayXf& answers, float radii,
                                 Eigen::ArrayXf& derivative) {
  std::vector<float> shares(samples.trials.size(), 0.0F);
  const float log_allowed = std::log(radii);
  derivative.resize(answers.size());
  for (Eigen::Index i = 0; i < answers.size(); ++i) {
    const std::size_t kind = samples.kind[static_cast<std::size_t>(i)];
    const float inside = sigmoid((answers[i] + log_allowed - samples.log_radii[i]) / kSmooth);
    shares[kind] += inside / samples.trials[kind];
    derivative[i] = inside * (1 - inside) / kSmooth / samples.trials[kind];
  }
  return shares;
}

/// Of the loss by every answer.
Eigen::MatrixXf loss_gradient(const Samples& samples, const Eigen::ArrayXf& answers) {
  Eigen::MatrixXf gradient = Eigen::MatrixXf::Zero(1, answers.size());
  Eigen::ArrayXf derivative;
  const auto add = [&](float radii, const auto& by_share) {
    const std::vector<float> shares = shares_inside(samples, answers, radii, derivative);
    for (Eigen::Index i = 0; i < answers.size(); ++i) {
      const std::size_t kind = samples.kind[static_cast<std::size_t>(i)];
      gradient(0, i) += by_share(kind < kFirstOther, shares[kind]) * derivative[i];
    }
  };
  add(1, [](bool of_scene, float inside) { return of_scene ? 2 * kOnceWeight * (inside - kInside) : 0; });
  add(2, [](bool of_scene, float inside) { return of_scene ? 2 * kTwiceWeight * (inside - kInsideTwice) : 0; });
  add(3, [](bool of_scene, float inside) { return of_scene ? -2 * kBeyondWeight * (1 - inside) : -kOthersWeight; });
  return gradient;
}

/// Means and reciprocal deviations of the features, in turn.
std::vector<float> normalisation(const std::vector<TouchTrial>& trials) {
  Eigen::Array<double, TouchModel::kRadiusFeatures, 1> sum, square;
  sum.setZero();
  square.setZero();
  for (const TouchTrial& trial : trials) {
    const auto features =
        Eigen::Map<const Eigen::Array<float, TouchModel::kRadiusFeatures, 1>>(trial.radius_features.data())
            .cast<double>();
    sum += features;
    square += features.square();
  }
  const auto count = static_cast<double>(trials.size());
  std::vector<float> numbers;
  for (int i = 0; i < TouchModel::kRadiusFeatures; ++i) {
    constexpr double kConstant = 1e-6;
    const double mean = sum[i] / count, deviation = std::sqrt(std::max(0.0, square[i] / count - mean * mean));
    numbers.push_back(static_cast<float>(mean));
    numbers.push_back(deviation > kConstant ? static_cast<float>(1 / deviation) : 0.0F);
  }
  return numbers;
}

Samples samples_of(const std::vector<TouchTrial>& trials, const std::vector<float>& inputs) {
  Samples samples;
  samples.inputs.resize(TouchModel::kRadiusFeatures, static_cast<Eigen::Index>(trials.size()));
  samples.log_radii.resize(samples.inputs.cols());
  for (std::size_t k = 0; k < trials.size(); ++k) {
    const auto column = static_cast<Eigen::Index>(k);
    std::ranges::copy(normalised(inputs, trials[k].radius_features), samples.inputs.col(column).data());
    constexpr float kLeastError = 1e-6F;
    samples.log_radii[column] = std::log(std::max(trials[k].error_mm.norm() / trials[k].radius_68_mm, kLeastError));
    samples.kind.push_back(kind_of(trials[k]));
  }
  samples.trials.resize(*std::ranges::max_element(samples.kind) + 1, 0.0F);
  for (const std::size_t kind : samples.kind) ++samples.trials[kind];
  return samples;
}

/// What is to be added to the answers so that the radius holds kInside of the errors, all kinds of the scene alike.
float missing(const Samples& samples, const Eigen::ArrayXf& answers) {
  std::vector<std::pair<float, float>> beyond;  // by how much an error is larger than the radius, its weight
  float all = 0, below = 0;
  for (Eigen::Index i = 0; i < answers.size(); ++i) {
    const std::size_t kind = samples.kind[static_cast<std::size_t>(i)];
    if (kind >= kFirstOther) continue;
    beyond.emplace_back(samples.log_radii[i] - answers[i], 1 / samples.trials[kind]);
    all += beyond.back().second;
  }
  std::ranges::sort(beyond);
  for (const auto& [log_radii, weight] : beyond) {
    below += weight;
    if (below >= kInside * all) return log_radii;
  }
  return 0;
}

}  // namespace

void fit_radius_network(const std::vector<TouchTrial>& trials, double threshold_mm, TouchModelData& model) {
  std::vector<TouchTrial> published;
  bool has_scene = false;
  for (const TouchTrial& trial : trials) {
    const bool is_weak = static_cast<double>(trial.plate_motion_mm) < threshold_mm;
    const float above = trial.gravity_is_known ? model.explained_above : model.explained_above_unknown_g;
    const bool is_touch = trial.radius_68_mm > 0 && trial.explained >= above;
    if (trial.scene < kFirstKept || is_weak || !is_touch) continue;
    has_scene = has_scene || trial.scene < kFirstKept + kKindsOfTouch;
    published.push_back(trial);
  }
  if (!has_scene) return;
  const std::vector<float> inputs = normalisation(published);
  const Samples samples = samples_of(published, inputs);
  Random random(1);
  Network network({TouchModel::kRadiusWidths.begin(), TouchModel::kRadiusWidths.end()}, Activation::kAlgebraicSilu,
                  random);
  Adam adam(network);
  Progress progress("radius of every kind of touch", kFitSteps);
  for (int step = 0; step < kFitSteps; ++step) {
    if (interrupted()) throw Interrupted();
    network.backward(loss_gradient(samples, network.forward(samples.inputs).row(0).transpose().array()));
    const float rate = cosine_rate(kFitRate, step, kFitSteps);
    adam.step(network, rate);
    for (Network::Layer& layer : network.layers()) layer.weights *= 1 - kFitDecay * rate;
    progress.advance();
  }
  network.layers().back().bias[0] += missing(samples, network.forward(samples.inputs).row(0).transpose().array());
  model.radius_inputs = inputs;
  for (std::size_t l = 0; l < model.radius.size(); ++l) model.radius[l] = float_layer(network.layers()[l]);
}

}  // namespace finsight::host
