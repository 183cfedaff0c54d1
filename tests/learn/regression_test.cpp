#include "hostgen/learn/regression.h"

#include <doctest/doctest.h>

#include <cmath>

using namespace finsight::host;

namespace {

struct Samples {
  Eigen::MatrixXf inputs, targets;
};
Samples draw(int count, std::uint64_t seed) {
  Random random(seed);
  Samples samples{Eigen::MatrixXf(3, count), Eigen::MatrixXf(2, count)};
  for (int i = 0; i < count; ++i) {
    const float x = float(random.uniform(-2, 2)), y = float(random.uniform(500, 600));
    samples.inputs.col(i) << x, y, 7.0f;  // one input is constant
    samples.targets.col(i) << 100 + 30 * std::sin(x), 0.01f * y;
  }
  return samples;
}

}  // namespace

TEST_CASE("regression: learns a smooth function whatever the scales of inputs and outputs") {
  const Samples samples = draw(500, 1), fresh = draw(100, 2);
  int ticks = 0;
  Regression network(samples.inputs, samples.targets,
                     {.hidden = {32, 32}, .steps = 1500, .batch = 32, .peak_rate = 1e-2f}, [&] { ++ticks; });
  CHECK(ticks == 1500);
  const Eigen::MatrixXf error = network.predict(fresh.inputs) - fresh.targets;
  CHECK(error.row(0).cwiseAbs().mean() < 1.0f);
  CHECK(error.row(1).cwiseAbs().mean() < 0.03f);
}

TEST_CASE("regression: same seed, same bytes") {
  const Samples samples = draw(100, 1);
  const RegressionPlan plan{.hidden = {8}, .steps = 20, .batch = 8};
  Regression a(samples.inputs, samples.targets, plan, [] {}), b(samples.inputs, samples.targets, plan, [] {});
  CHECK(a.predict(samples.inputs) == b.predict(samples.inputs));
}
