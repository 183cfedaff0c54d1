#include "hostgen/learn/touch_network.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "firmware/geometry/plate_motion.h"
#include "firmware/touch/features.h"

namespace finsight::host {

namespace {

constexpr int kMeans = TouchModel::kMeans, kLogOdds = TouchModel::kOutputs - 1;
constexpr int kExplainedTarget = kMeans, kLocatedTarget = kMeans + 1;
constexpr std::array<int, 9> kWithSigma = {0, 1, 2, 6, 7, 8, 9, 10, 11};  // with a log-sigma, at output kMeans + index
constexpr float kPeakRate = 2e-3f;
constexpr std::array kWidths = {TouchModel::kInputs, 256, 256, 256, 256, TouchModel::kOutputs};

// Mean and standard deviation of every row; a row that does not vary is not scaled.
void statistics(const Eigen::MatrixXf& rows, std::vector<float>& mean, std::vector<float>& sigma) {
  for (int i = 0; i < rows.rows(); ++i) {
    const Eigen::ArrayXd row = rows.row(i).transpose().cast<double>();
    const double centre = row.mean();
    const double spread = std::sqrt((row - centre).square().mean());
    mean.push_back(static_cast<float>(centre));
    sigma.push_back(spread > 1e-6 ? static_cast<float>(spread) : 1.0f);
  }
}

GravityCorrection gravity_of(const TouchTrainingPlan& plan) {
  TouchModel model;
  model.per_g = plan.per_g;
  model.per_g_change = plan.per_g_change;
  return {model, std::nullopt};
}

// Draws random touches and measures them: noise, missing plates, features. One column of inputs and targets per touch.
class Measurements {
 public:
  Measurements(const std::vector<TouchSample>& touches, const std::array<PoseNoise, kPlates>& noise,
               const PlatePrior& prior, const TouchTrainingPlan& plan, const CornerMeasurement* camera, Random& random)
      : touches_(touches),
        noise_(noise),
        prior_(prior),
        plate_height_mm_(plan.plate_height_mm),
        gravity_(gravity_of(plan)),
        camera_(camera),
        random_(random) {}

  void draw(const TouchModel& model, Eigen::MatrixXf& inputs, Eigen::MatrixXf& targets) {
    for (int column = 0; column < inputs.cols(); ++column) {
      const TouchSample& touch = touches_[random_.index(touches_.size())];
      PoseVector numbers = touch.numbers;
      const float unknown_g = add_gravity(gravity_, random_, numbers);
      const float swing_mm = add_swing(plate_height_mm_, random_, numbers);
      const bool has_loose_plate = random_.uniform() < kLooseShare;
      if (has_loose_plate) loosen_plate(random_, numbers);
      const bool is_explained = touch.explained && !has_loose_plate && swing_mm < kExplainedSwing_mm;
      const std::array<bool, kPlates> seen = draw_seen(random_);
      std::array<float, kPlates> noise;
      if (camera_ && random_.uniform() < 0.5) {
        noise = camera_->measure(seen, random_, numbers);
      } else {
        noise = draw_noise(random_);
        add_noise(noise_, random_, numbers, noise);
        complete_from_prior(prior_, seen, numbers);
      }
      for (std::size_t p = 0; p < kPlates; ++p) noise[p] = network_noise(seen[p], noise[p]);
      touch_features(model, numbers, noise, unknown_g,
                     std::span<float, TouchModel::kInputs>(inputs.col(column).data(), TouchModel::kInputs));
      targets.col(column) << touch.point_mm, touch.displacement_mm, touch.force_vector_n, touch.moment_nm,
          is_explained ? 1.0F : 0.0F, touch.on_face && !has_loose_plate ? 1.0F : 0.0F;
    }
  }

 private:
  static constexpr double kLooseShare = 0.03;
  static constexpr float kExplainedSwing_mm = 0.5F;  // smaller ones widen the radius instead
  const std::vector<TouchSample>& touches_;
  const std::array<PoseNoise, kPlates>& noise_;
  const PlatePrior& prior_;
  const std::array<double, kPlates>& plate_height_mm_;
  const GravityCorrection gravity_;
  const CornerMeasurement* camera_;
  Random& random_;
};

// Scales inputs and outputs to about one, from the statistics of measured touches.
constexpr int kDraws = 4096;
TouchModelData fit_normalisation(Measurements& measurements) {
  TouchModelData model;
  for (int i = 0; i < kPoseDims; ++i) model.scale.push_back(i % 6 < 3 ? 1.0f : kMillimetresPerRadian);
  model.input_mean.assign(TouchModel::kInputs, 0.0f);
  model.input_scale.assign(TouchModel::kInputs, 1.0f);
  Eigen::MatrixXf inputs(TouchModel::kInputs, kDraws), targets(kTouchTargets, kDraws);
  TouchModel raw = model.view();
  measurements.draw(raw, inputs, targets);

  std::vector<float> sigma;
  model.input_mean.clear();
  statistics(inputs, model.input_mean, sigma);
  for (std::size_t i = 0; i < sigma.size(); ++i) model.input_scale[i] = 1.0f / sigma[i];
  statistics(targets.topRows<kMeans>(), model.output_mean, model.output_scale);
  for (const int mean : kWithSigma) {
    model.output_mean.push_back(std::log(model.output_scale[static_cast<std::size_t>(mean)]));
    model.output_scale.push_back(1.0f);
  }
  model.output_mean.push_back(0.0F);  // of the log-odds
  model.output_scale.push_back(1.0F);
  return model;
}

/// [TouchModel::kInputs, kInputs] Makes the pose numbers uncorrelated and of equal size; leaves the other inputs alone.
/// A touch moves the plates mostly in few directions, and what tells friction from position is small beside them:
/// training on the numbers as they are takes about twice as many steps to the same error. `inputs`: [kInputs, samples].
Eigen::MatrixXf whitening(const Eigen::MatrixXf& inputs) {
  constexpr double kSmallestVariance = 1e-6;  // of the normalised numbers: at rest all of them may be the same
  const Eigen::MatrixXd poses = inputs.topRows<kPoseDims>().cast<double>();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> spread(poses * poses.transpose() /
                                                              static_cast<double>(poses.cols()));
  const Eigen::VectorXd factors = spread.eigenvalues().cwiseMax(kSmallestVariance).cwiseSqrt().cwiseInverse();
  Eigen::MatrixXf white = Eigen::MatrixXf::Identity(inputs.rows(), inputs.rows());
  white.topLeftCorner<kPoseDims, kPoseDims>() =
      (factors.asDiagonal() * spread.eigenvectors().transpose()).cast<float>();
  return white;
}

}  // namespace

TouchModel TouchModelData::view() const {
  TouchModel model{.scale = scale,
                   .input_mean = input_mean,
                   .input_scale = input_scale,
                   .output_mean = output_mean,
                   .output_scale = output_scale,
                   .radius_curve = radius_curve,
                   .radius_inputs = radius_inputs,
                   .radius = {radius[0].view(), radius[1].view(), radius[2].view()},
                   .seen_factor = seen_factor,
                   .first = first.view(),
                   .last = last.view(),
                   .middle = {},
                   .face_axes = face_axes,
                   .threshold_mm = threshold_mm,
                   .range_mm = range_mm,
                   .explained_above = explained_above,
                   .explained_above_unknown_g = explained_above_unknown_g,
                   .per_g = per_g,
                   .per_g_change = per_g_change,
                   .stiffness_tolerance = stiffness_tolerance,
                   .marker_tolerance_mm = marker_tolerance_mm,
                   .marker_tolerance_rad = marker_tolerance_rad,
                   .touch_tolerance_mm = touch_tolerance_mm,
                   .noise_per_mm = noise_per_mm};
  for (std::size_t l = 0; l < TouchModel::kRounded; ++l) {
    const int inputs = l == 0 ? first.outputs : static_cast<int>(bias[l - 1].size());
    model.middle[l] = {inputs, static_cast<int>(bias[l].size()), weights[l], weight_scale[l], bias[l]};
  }
  return model;
}

void touch_loss_gradient(const Eigen::MatrixXf& outputs, const Eigen::MatrixXf& targets, bool likelihood,
                         Eigen::MatrixXf& gradient) {
  // A single outlier, such as a swing that looks like a touch elsewhere, must not dominate means and deviations.
  // A number that does not vary in the scene, such as friction's force without friction, would be told ever more
  // exactly. And a deviation that runs away would weigh its own gradient ever more.
  constexpr float kSmallestSigma = 0.003f, kLargestWeight = 5.0f;
  constexpr float kLargestError = 5.0f, kLargestSquare = kLargestError * kLargestError;
  const float share = 1.0f / static_cast<float>(outputs.cols());
  gradient.setZero(outputs.rows(), outputs.cols());
  gradient.topRows<kMeans>() =
      share * (outputs.topRows<kMeans>() - targets.topRows<kMeans>()) * targets.row(kLocatedTarget).asDiagonal();
  for (int s = 0; s < outputs.cols(); ++s) {
    const float odds = std::exp(std::clamp(outputs(kLogOdds, s), -30.0F, 30.0F));
    gradient(kLogOdds, s) = share * (odds / (1 + odds) - targets(kExplainedTarget, s));
  }
  if (!likelihood) return;
  for (int s = 0; s < outputs.cols(); ++s) {
    if (targets(kLocatedTarget, s) == 0) continue;
    const float force_sigma = std::max(std::exp(outputs(kMeans + 3, s)), kSmallestSigma);
    gradient.col(s).segment<3>(3) =
        (gradient.col(s).segment<3>(3) / force_sigma).cwiseMax(-share * kLargestError).cwiseMin(share * kLargestError);
    for (int k = 0; k < static_cast<int>(kWithSigma.size()); ++k) {
      const int mean = kWithSigma[static_cast<std::size_t>(k)];
      const float sigma = std::exp(outputs(kMeans + k, s));
      if (sigma < kSmallestSigma) {
        const float error = (outputs(mean, s) - targets(mean, s)) / kSmallestSigma;
        gradient(mean, s) = share * std::clamp(error, -kLargestError, kLargestError);
        gradient(kMeans + k, s) = share * (sigma - kSmallestSigma);
        continue;
      }
      const float error = (outputs(mean, s) - targets(mean, s)) / sigma;
      gradient(mean, s) = share * std::clamp(error, -kLargestError, kLargestError);
      gradient(kMeans + k, s) =
          share * std::min(sigma, kLargestWeight) * (1.0f - std::min(error * error, kLargestSquare));
    }
  }
}

void check_converged(const Eigen::MatrixXf& outputs, const Eigen::MatrixXf& targets) {
  constexpr float kLargestRms = 10;  // targets have a deviation of 1
  const Eigen::RowVectorXf located = targets.row(kLocatedTarget);
  const float sum = (outputs.topRows<kMeans>().colwise().squaredNorm() * located.transpose())(0);
  const float rms = std::sqrt(sum / (kMeans * std::max(1.0f, located.sum())));
  if (outputs.allFinite() && rms < kLargestRms) return;
  throw std::runtime_error("the touch network's training diverged (its answers have an RMS of " + std::to_string(rms) +
                           " where 1 is right); another --seed or other --training-steps may do");
}

TouchNetwork train_touch_network(const std::vector<TouchSample>& touches, const std::array<PoseNoise, kPlates>& noise,
                                 const PlatePrior& prior, const TouchTrainingPlan& plan, std::uint64_t seed,
                                 const std::function<void()>& tick, const CornerMeasurement* camera) {
  Random random(seed);
  Measurements measurements(touches, noise, prior, plan, camera, random);
  TouchNetwork trained{Network({kWidths.begin(), kWidths.end()}, Activation::kAlgebraicSilu, random),
                       fit_normalisation(measurements),
                       {}};
  TouchModelData& model = trained.model;
  model.per_g = plan.per_g;
  model.per_g_change = plan.per_g_change;
  const TouchModel view = model.view();
  const Eigen::Map<const Eigen::ArrayXf> mean(model.output_mean.data(), kMeans),
      scale(model.output_scale.data(), kMeans);

  trained.sample_inputs.resize(TouchModel::kInputs, kDraws);
  Eigen::MatrixXf sample_targets(kTouchTargets, kDraws);
  measurements.draw(view, trained.sample_inputs, sample_targets);
  const Eigen::MatrixXf white = whitening(trained.sample_inputs);
  Eigen::MatrixXf inputs(TouchModel::kInputs, plan.batch), targets(kTouchTargets, plan.batch), gradient;
  Adam adam(trained.network);
  for (int step = 0; step < plan.steps; ++step) {
    measurements.draw(view, inputs, targets);
    targets.topRows<kMeans>() = ((targets.topRows<kMeans>().array().colwise() - mean).colwise() / scale).matrix();
    touch_loss_gradient(trained.network.forward(white * inputs), targets, step >= plan.steps / 5, gradient);
    trained.network.backward(gradient);
    adam.step(trained.network, cosine_rate(kPeakRate, step, plan.steps));
    tick();
  }
  check_converged(trained.network.forward(white * trained.sample_inputs), sample_targets);
  Eigen::MatrixXf& first = trained.network.layers().front().weights;
  first = (first * white).eval();  // the firmware's inputs are not white
  return trained;
}

Eigen::Matrix<float, TouchModel::kOutputs, 1> evaluate(TouchNetwork& trained, const PoseVector& numbers,
                                                       const std::array<float, kPlates>& noise, float unknown_g) {
  const TouchModel model = trained.model.view();
  Eigen::Matrix<float, TouchModel::kInputs, 1> inputs;
  touch_features(model, numbers, noise, unknown_g,
                 std::span<float, TouchModel::kInputs>(inputs.data(), TouchModel::kInputs));
  Eigen::Matrix<float, TouchModel::kOutputs, 1> outputs = trained.network.forward(inputs);
  for (int i = 0; i < TouchModel::kOutputs; ++i) {
    const auto k = static_cast<std::size_t>(i);
    outputs[i] = model.output_mean[k] + model.output_scale[k] * outputs[i];
  }
  return outputs;
}

}  // namespace finsight::host
