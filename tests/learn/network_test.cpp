#include "hostgen/learn/network.h"

#include <doctest/doctest.h>

#include <cmath>

#include "firmware/touch/int8_network.h"

using namespace finsight::host;

namespace {

Eigen::MatrixXf random_matrix(int rows, int cols, Random& random) {
  Eigen::MatrixXf matrix(rows, cols);
  for (float& value : matrix.reshaped()) value = static_cast<float>(random.normal());
  return matrix;
}

double half_square(const Eigen::MatrixXf& difference) { return 0.5 * difference.cast<double>().squaredNorm(); }

}  // namespace

TEST_CASE("network: a forward pass equals the formula written out") {
  Random random(3);
  for (const Activation activation : {Activation::kRelu, Activation::kAlgebraicSilu}) {
    Network network({4, 5, 2}, activation, random);
    network.layers()[0].bias.setConstant(0.1f);
    const Eigen::MatrixXf x = random_matrix(4, 1, random);
    const Eigen::MatrixXf y = network.forward(x);
    for (int o = 0; o < 2; ++o) {
      double expected = 0;
      for (int h = 0; h < 5; ++h) {
        float sum = 0.1f;
        for (int i = 0; i < 4; ++i) sum += network.layers()[0].weights(h, i) * x(i, 0);
        const float hidden = activation == Activation::kRelu ? std::max(sum, 0.0f) : finsight::algebraic_silu(sum);
        expected += double(network.layers()[1].weights(o, h)) * double(hidden);
      }
      CHECK(double(y(o, 0)) == doctest::Approx(expected).epsilon(1e-5));
    }
  }
}

namespace {

void check_gradients(Activation activation) {
  Random random(5);
  Network network({6, 12, 9, 3}, activation, random);
  for (auto& layer : network.layers()) layer.bias = random_matrix(int(layer.bias.size()), 1, random) * 0.3f;
  const Eigen::MatrixXf inputs = random_matrix(6, 7, random), targets = random_matrix(3, 7, random);
  network.backward(network.forward(inputs) - targets);
  const std::vector<Network::Layer> gradients = network.gradients();
  const auto loss = [&] { return half_square(network.forward(inputs) - targets); };
  // Steps are small enough to cross hardly any kink of a ReLU; the loss is summed in double.
  const float step = 2e-3f;
  for (std::size_t l = 0; l < gradients.size(); ++l) {
    double difference_sq = 0, size_sq = 0;
    const auto compare = [&](float& parameter, float gradient) {
      const float kept = parameter;
      parameter = kept + step;
      const double above = loss();
      parameter = kept - step;
      const double below = loss();
      parameter = kept;
      const double slope = (above - below) / (2 * double(step));
      difference_sq += (slope - double(gradient)) * (slope - double(gradient));
      size_sq += slope * slope;
    };
    Network::Layer& layer = network.layers()[l];
    for (int i = 0; i < layer.weights.size(); ++i) compare(layer.weights.data()[i], gradients[l].weights.data()[i]);
    for (int i = 0; i < layer.bias.size(); ++i) compare(layer.bias[i], gradients[l].bias[i]);
    CHECK(size_sq > 1);
    CHECK(std::sqrt(difference_sq / size_sq) < 3e-3);
  }
}

}  // namespace

TEST_CASE("network: gradients agree with finite differences in every layer") {
  check_gradients(Activation::kRelu);
  check_gradients(Activation::kAlgebraicSilu);
}

TEST_CASE("network: Adam fits a known function") {
  Random random(11);
  Network network({2, 32, 32, 1}, Activation::kRelu, random);
  Adam adam(network);
  const auto truth = [](float a, float b) { return std::sin(2 * a) + a * b; };
  Eigen::MatrixXf inputs(2, 64), targets(1, 64);
  const auto draw = [&] {
    for (int s = 0; s < 64; ++s) {
      inputs(0, s) = float(random.uniform(-1, 1));
      inputs(1, s) = float(random.uniform(-1, 1));
      targets(0, s) = truth(inputs(0, s), inputs(1, s));
    }
  };
  constexpr int kSteps = 2000;
  for (int step = 0; step < kSteps; ++step) {
    draw();
    network.backward((network.forward(inputs) - targets) / 64.0f);
    adam.step(network, cosine_rate(5e-3f, step, kSteps));
  }
  draw();  // points that it was not trained on
  const double rms = std::sqrt(2 * half_square(network.forward(inputs) - targets) / 64);
  CHECK(rms < 0.02);
}

TEST_CASE("network: Adam's first step moves every weight by the rate against its gradient") {
  Random random(2);
  Network network({3, 4, 2}, Activation::kRelu, random);
  const std::vector<Network::Layer> before = network.layers();
  network.backward(network.forward(random_matrix(3, 5, random)) - random_matrix(2, 5, random));
  Adam adam(network);
  adam.step(network, 0.01f);
  int moved = 0;
  for (std::size_t l = 0; l < before.size(); ++l) {
    for (int i = 0; i < before[l].weights.size(); ++i) {
      const float gradient = network.gradients()[l].weights.data()[i];
      const float change = network.layers()[l].weights.data()[i] - before[l].weights.data()[i];
      if (std::abs(gradient) < 1e-3f) continue;
      CHECK(change == doctest::Approx(gradient > 0 ? -0.01 : 0.01).epsilon(1e-3));
      ++moved;
    }
  }
  CHECK(moved > 5);
}

TEST_CASE("network: after an odd batch Adam's step is as much smaller as its gradient exceeds those before") {
  const auto move_after = [](float size) {
    Random random(2);
    Network network({3, 4, 2}, Activation::kRelu, random);
    Adam adam(network);
    const Eigen::MatrixXf x = random_matrix(3, 5, random), slope = random_matrix(2, 5, random);
    Eigen::MatrixXf before;
    for (int step = 0; step < 50; ++step) {
      before = network.layers()[1].weights;
      network.forward(x);
      network.backward(step < 49 ? slope : Eigen::MatrixXf(size * slope));
      adam.step(network, 1e-6f);  // too little to change what reaches the layer
    }
    return double((network.layers()[1].weights - before).norm());
  };
  const double usual = move_after(1);
  // Adam alone would make three quarters of its usual step: the mean grows 11 times, its deviation 14 times. Of a
  // gradient that is seven times that deviation the step is a seventh.
  CHECK(move_after(100) < 0.15 * usual);
  CHECK(move_after(100) > 0.08 * usual);
}

TEST_CASE("network: the learning rate rises from nearly zero and ends at zero") {
  CHECK(cosine_rate(1, 0, 1000) < 0.01f);
  CHECK(cosine_rate(1, 500, 1000) == doctest::Approx(0.5));
  CHECK(cosine_rate(1, 999, 1000) < 1e-5f);
  CHECK(cosine_rate(1, 30, 1000) > 0.9f);
}

TEST_CASE("random: the same seed gives the same numbers, another seed others; moments are right") {
  Random a(1), b(1), c(2);
  CHECK(a.uniform() == b.uniform());
  CHECK(a.uniform() != c.uniform());
  double sum = 0, squares = 0, fourth = 0, lowest = 1, highest = 0;
  constexpr int kCount = 100000;
  for (int i = 0; i < kCount; ++i) {
    const double n = a.normal(), u = a.uniform();
    sum += n;
    squares += n * n;
    fourth += n * n * n * n;
    lowest = std::min(lowest, u);
    highest = std::max(highest, u);
  }
  CHECK(std::abs(sum / kCount) < 0.015);
  CHECK(squares / kCount == doctest::Approx(1).epsilon(0.02));
  CHECK(fourth / kCount == doctest::Approx(3).epsilon(0.05));
  CHECK(lowest >= 0);
  CHECK(highest < 1);
}
