#include "hostgen/learn/touch_network.h"

#include <doctest/doctest.h>

#include <cmath>
#include <limits>

#include "firmware/touch/int8_network.h"
#include "tests/learn/synthetic_finger.h"

using namespace finsight;
using namespace finsight::host;

namespace {

constexpr int kSigmaMeans[9] = {0, 1, 2, 6, 7, 8, 9, 10, 11};

Eigen::MatrixXf random_matrix(int rows, int cols, double size, Random& random) {
  Eigen::MatrixXf matrix(rows, cols);
  for (float& value : matrix.reshaped()) value = float(size * random.normal());
  return matrix;
}

// Negative log-likelihood of one target among `samples`, weighted with a standard deviation that is held fixed.
double weighted_likelihood(double mean, double log_sigma, double target, double weight, int samples) {
  const double error = (mean - target) / std::exp(log_sigma);
  return weight * (0.5 * error * error + log_sigma) / samples;
}

/// Of explained touches on the face.
Eigen::MatrixXf random_targets(int samples, Random& random) {
  Eigen::MatrixXf targets = Eigen::MatrixXf::Ones(kTouchTargets, samples);
  targets.topRows(12) = random_matrix(12, samples, 1, random);
  return targets;
}

std::vector<TouchSample> some_touches(std::size_t count) {
  const StateInterpolant states(test::synthetic_dataset().states);
  Random random(1);
  return draw_touches(test::synthetic_spec(), states, count, random);
}

TouchNetwork short_training(std::uint64_t seed) {
  static const std::vector<TouchSample> touches = some_touches(1000);
  static const PlatePriorData prior = fit_plate_prior(test::synthetic_dataset(), test::synthetic_spec().noise);
  TouchTrainingPlan plan;
  plan.steps = 30;
  plan.batch = 32;
  return train_touch_network(touches, test::synthetic_spec().noise, prior.view(), plan, seed, [] {});
}

}  // namespace

TEST_CASE("touch network: the likelihood's gradient agrees with finite differences") {
  Random random(9);
  const int samples = 5;
  const Eigen::MatrixXf targets = random_targets(samples, random);
  Eigen::MatrixXf outputs = random_matrix(TouchModel::kOutputs, samples, 0.5, random), gradient;
  outputs.topRows(12) = targets.topRows(12) + random_matrix(12, samples, 0.3, random);
  touch_loss_gradient(outputs, targets, true, gradient);
  for (int s = 0; s < samples; ++s) {
    for (int k = 0; k < 9; ++k) {
      const double mean = double(outputs(kSigmaMeans[k], s)), log_sigma = double(outputs(12 + k, s));
      const double target = double(targets(kSigmaMeans[k], s)), weight = std::exp(log_sigma), h = 1e-5;
      const auto loss = [&](double m, double u) { return weighted_likelihood(m, u, target, weight, samples); };
      CHECK(double(gradient(kSigmaMeans[k], s)) ==
            doctest::Approx((loss(mean + h, log_sigma) - loss(mean - h, log_sigma)) / (2 * h)).epsilon(1e-4));
      CHECK(double(gradient(12 + k, s)) ==
            doctest::Approx((loss(mean, log_sigma + h) - loss(mean, log_sigma - h)) / (2 * h)).epsilon(1e-4));
    }
    for (int i = 3; i < 6; ++i) {  // the displacement: squared error with the force's weight
      CHECK(double(gradient(i, s)) ==
            doctest::Approx(double(outputs(i, s) - targets(i, s)) / std::exp(double(outputs(15, s))) / samples));
    }
  }
}

TEST_CASE("touch network: the first part of the training sees squared errors only") {
  Random random(10);
  const Eigen::MatrixXf targets = random_targets(4, random), outputs = random_matrix(22, 4, 1, random);
  Eigen::MatrixXf gradient;
  touch_loss_gradient(outputs, targets, false, gradient);
  CHECK((gradient.topRows(12) - (outputs.topRows(12) - targets.topRows(12)) / 4).norm() < 1e-6f);
  CHECK(gradient.middleRows(12, 9).norm() == 0);
}

TEST_CASE("touch network: whether a touch explains the motion is learnt by its cross entropy") {
  Random random(11);
  Eigen::MatrixXf targets = random_targets(2, random), outputs = random_matrix(22, 2, 1, random), gradient;
  targets.row(12) << 1, 0;
  touch_loss_gradient(outputs, targets, true, gradient);
  const auto probability = [&](int s) { return 1 / (1 + std::exp(-double(outputs(21, s)))); };
  CHECK(double(gradient(21, 0)) == doctest::Approx((probability(0) - 1) / 2));
  CHECK(double(gradient(21, 1)) == doctest::Approx(probability(1) / 2));
}

TEST_CASE("touch network: nothing but that is learnt from a push beside the face") {
  Random random(12);
  Eigen::MatrixXf targets = random_targets(1, random), outputs = random_matrix(22, 1, 1, random), gradient;
  targets.bottomRows(2).setZero();
  for (const bool likelihood : {false, true}) {
    touch_loss_gradient(outputs, targets, likelihood, gradient);
    CHECK(gradient.topRows(21).norm() == 0);
    CHECK(gradient(21, 0) > 0);
  }
}

TEST_CASE("touch network: an outlier's pull on a mean and its deviation is bounded") {
  Eigen::MatrixXf outputs = Eigen::MatrixXf::Zero(22, 1), targets = Eigen::MatrixXf::Ones(14, 1), gradient;
  targets.topRows(12).setZero();
  targets(0, 0) = 1e4f;
  touch_loss_gradient(outputs, targets, true, gradient);
  CHECK(double(gradient(12, 0)) == doctest::Approx(-24));
  CHECK(double(gradient(0, 0)) == doctest::Approx(-5));
}

TEST_CASE("touch network: no gradient runs away, neither where a deviation is near zero nor where it is huge") {
  Eigen::MatrixXf outputs = Eigen::MatrixXf::Zero(22, 1), targets = Eigen::MatrixXf::Ones(14, 1), gradient;
  targets.topRows(12).setConstant(100);
  outputs.middleRows(12, 9).setConstant(-20);
  touch_loss_gradient(outputs, targets, true, gradient);
  CHECK(double(gradient.topRows(12).cwiseAbs().maxCoeff()) == doctest::Approx(5));
  outputs.middleRows(12, 9).setConstant(20);
  touch_loss_gradient(outputs, targets, true, gradient);
  CHECK(double(gradient.middleRows(12, 9).cwiseAbs().maxCoeff()) == doctest::Approx(5));
}

TEST_CASE("touch network: a training has diverged if it answers nonsense where touches are learnt, not elsewhere") {
  Eigen::MatrixXf outputs = Eigen::MatrixXf::Zero(22, 4), targets = Eigen::MatrixXf::Zero(14, 4);
  targets.row(13) << 1, 1, 0, 0;
  outputs.rightCols(2).topRows(12).setConstant(1000);
  CHECK_NOTHROW(check_converged(outputs, targets));
  outputs.col(0).setConstant(16);
  CHECK_THROWS_WITH(check_converged(outputs, targets), doctest::Contains("diverged (its answers have an RMS of 11.3"));
  outputs.col(0).setZero();
  outputs(21, 3) = std::numeric_limits<float>::quiet_NaN();
  CHECK_THROWS_WITH(check_converged(outputs, targets), doctest::Contains("diverged"));
}

namespace {

// What reaches the first rounded layer for the network's own samples.
Eigen::MatrixXf reaching_middle(const TouchNetwork& trained) {
  const Network::Layer& first = trained.network.layers()[0];
  Eigen::MatrixXf inputs = (first.weights * trained.sample_inputs).colwise() + first.bias;
  activate(Activation::kAlgebraicSilu, inputs);
  return inputs;
}

// That layer's sums, as rounded.
Eigen::MatrixXf rounded_sums(const TouchNetwork& trained) {
  const DenseInt8 layer = trained.model.view().middle[0];
  Eigen::MatrixXf weights(layer.outputs, layer.inputs);
  for (int o = 0; o < layer.outputs; ++o) {
    for (int i = 0; i < layer.inputs; ++i) {
      weights(o, i) = layer.scale[std::size_t(o)] * float(layer.weights[std::size_t(o * layer.inputs + i)]);
    }
  }
  return (weights * reaching_middle(trained)).colwise() +
         Eigen::Map<const Eigen::VectorXf>(layer.bias.data(), layer.outputs);
}

// The same with every weight rounded independently.
Eigen::MatrixXf naive_sums(const TouchNetwork& trained) {
  const Network::Layer& layer = trained.network.layers()[1];
  const Eigen::ArrayXf scale = (layer.weights.cwiseAbs().rowwise().maxCoeff() / 127).array().max(1e-30f);
  const Eigen::MatrixXf weights = ((layer.weights.array().colwise() / scale).round().colwise() * scale).matrix();
  return (weights * reaching_middle(trained)).colwise() + layer.bias;
}

}  // namespace

TEST_CASE("touch network: int8 weights use their range, and a channel of zero weights gets scale one") {
  TouchNetwork trained = short_training(1);
  trained.network.layers()[2].weights.row(3).setZero();
  quantise(trained);
  for (std::size_t l = 0; l < TouchModel::kRounded; ++l) {
    const Network::Layer& layer = trained.network.layers()[l + 1];
    const DenseInt8 rounded = trained.model.view().middle[l];
    REQUIRE(rounded.inputs == layer.weights.cols());
    REQUIRE(rounded.outputs == layer.weights.rows());
    int largest = 0;
    for (const std::int8_t weight : rounded.weights) largest = std::max(largest, std::abs(int(weight)));
    CHECK(largest >= 120);
    for (const float scale : rounded.scale) CHECK(scale > 0);
  }
  const DenseInt8 middle = trained.model.view().middle[1];
  for (int i = 0; i < middle.inputs; ++i) CHECK(middle.weights[std::size_t(3 * middle.inputs + i)] == 0);
  CHECK(middle.scale[3] == 1);
}

TEST_CASE("touch network: compensated rounding changes the outputs less than independent rounding") {
  TouchNetwork trained = short_training(1);
  quantise(trained);
  const Network::Layer& layer = trained.network.layers()[1];
  const Eigen::MatrixXf exact = (layer.weights * reaching_middle(trained)).colwise() + layer.bias;
  const float repaired = (rounded_sums(trained) - exact).norm(), naive = (naive_sums(trained) - exact).norm();
  CHECK(repaired < 0.9f * naive);
  CHECK(repaired > 0);
}

TEST_CASE("touch network: the first layer keeps its floats, and the last takes up what rounding changes on average") {
  TouchNetwork trained = short_training(1);
  quantise(trained);
  const TouchModel model = trained.model.view();
  const Network::Layer &first = trained.network.layers().front(), &last = trained.network.layers().back();
  for (int o = 0; o < model.first.outputs; ++o) {
    CHECK(model.first.bias[std::size_t(o)] == first.bias[o]);
    for (int i = 0; i < model.first.inputs; ++i) {
      CHECK(model.first.weights[std::size_t(o * model.first.inputs + i)] == first.weights(o, i));
    }
  }
  for (int o = 0; o < model.last.outputs; ++o) {
    for (int i = 0; i < model.last.inputs; ++i) {
      CHECK(model.last.weights[std::size_t(o * model.last.inputs + i)] == last.weights(o, i));
    }
  }
  const Eigen::VectorXf exact = trained.network.forward(trained.sample_inputs).rowwise().mean();
  Eigen::VectorXf mean = Eigen::VectorXf::Zero(model.last.outputs);
  std::vector<float> x, y;
  for (const auto& sample : trained.sample_inputs.colwise()) {
    x.assign(sample.begin(), sample.end());
    const auto next = [&](const auto& layer) {
      y.resize(std::size_t(layer.outputs));
      forward(layer, x, y);
    };
    next(model.first);
    for (const DenseInt8& layer : model.middle) {
      activate(y);
      x = y;
      next(layer);
    }
    activate(y);
    x = y;
    next(model.last);
    mean += Eigen::Map<const Eigen::VectorXf>(y.data(), model.last.outputs) / float(trained.sample_inputs.cols());
  }
  CHECK((mean - exact).cwiseAbs().maxCoeff() < 1e-4f);
}

TEST_CASE("touch network: the same seed gives the same bytes, another seed different ones") {
  TouchNetwork a = short_training(1), b = short_training(1), c = short_training(2);
  CHECK(a.network.layers()[1].weights == b.network.layers()[1].weights);
  CHECK(a.network.layers()[4].bias == b.network.layers()[4].bias);
  CHECK(a.model.input_mean == b.model.input_mean);
  CHECK(a.network.layers()[1].weights != c.network.layers()[1].weights);
}

TEST_CASE("touch samples: noise has the spec's deviations along the camera's axes") {
  std::array<PoseNoise, kPlates> noise = {};
  noise[1] = {0.1, 0.4, 0.02, 0.005};
  Random random(3);
  Eigen::ArrayXd squares = Eigen::ArrayXd::Zero(kPoseDims);
  constexpr int kCount = 20000;
  for (int i = 0; i < kCount; ++i) {
    PoseVector numbers = PoseVector::Zero();
    add_noise(noise, random, numbers);
    squares += numbers.cast<double>().array().square() / kCount;
  }
  const Eigen::ArrayXd sigma = squares.sqrt();
  CHECK(sigma.head(6).maxCoeff() == 0);
  CHECK(sigma.tail(6).maxCoeff() == 0);
  const double expected[6] = {0.1, 0.4, 0.1, 0.02, 0.005, 0.02};
  for (int i = 0; i < 6; ++i) CHECK(sigma[6 + i] == doctest::Approx(expected[i]).epsilon(0.03));
}

TEST_CASE("touch samples: one touch in twenty swings with the square of the height and rotates with its slope") {
  Random random(3);
  int swings = 0;
  for (int i = 0; i < 2000; ++i) {
    PoseVector numbers = PoseVector::Zero();
    add_swing({100, 50, 20}, random, numbers);
    if (numbers.isZero()) continue;
    ++swings;
    CHECK(numbers[6] == doctest::Approx(0.25F * numbers[0]));
    CHECK(numbers[14] == doctest::Approx(0.04F * numbers[2]));
    CHECK(numbers[3] == doctest::Approx(0.02F * numbers[2]));    // slope at the top, towards +z about x
    CHECK(numbers[11] == doctest::Approx(-0.01F * numbers[0]));  // towards +x about -z
    CHECK((numbers[1] == 0 && numbers[4] == 0));
  }
  CHECK(swings == doctest::Approx(100).epsilon(0.25));
  PoseVector numbers = PoseVector::Zero();
  for (int i = 0; i < 100; ++i) add_swing({}, random, numbers);
  CHECK(numbers.isZero());
}

TEST_CASE("touch samples: mostly all plates are seen, and always at least one") {
  Random random(4);
  int counts[4] = {}, each[3] = {};
  for (int i = 0; i < 10000; ++i) {
    const std::array<bool, kPlates> seen = draw_seen(random);
    ++counts[int(seen[0]) + int(seen[1]) + int(seen[2])];
    for (std::size_t p = 0; p < 3; ++p) each[p] += !seen[p];
  }
  CHECK(counts[0] == 0);
  CHECK(counts[1] == doctest::Approx(1000).epsilon(0.15));
  CHECK(counts[2] == doctest::Approx(1500).epsilon(0.15));
  for (const int missing : each) CHECK(missing == doctest::Approx((2 * 1000 + 1500) / 3.0).epsilon(0.15));
}

TEST_CASE("touch samples: drawn touches cover the face of the spec and all forces from rest") {
  const FingerSpec spec = test::synthetic_spec();
  double lowest_n = 9, highest_n = 0, lowest_y = 999, highest_y = 0;
  for (const TouchSample& touch : some_touches(3000)) {
    const double y_mm = double(touch.point_mm.y());
    CHECK(std::abs(double(touch.point_mm.x())) <= spec.half_width.at(y_mm) - spec.touch_edge_mm + 1e-4);
    lowest_n = std::min(lowest_n, double(touch.force_n));
    highest_n = std::max(highest_n, double(touch.force_n));
    lowest_y = std::min(lowest_y, y_mm);
    highest_y = std::max(highest_y, y_mm);
  }
  CHECK(lowest_n < 0.1);
  CHECK(highest_n > 5.9);
  CHECK(highest_n <= 6);
  CHECK(lowest_y < 14);
  CHECK(highest_y > 106);
}
