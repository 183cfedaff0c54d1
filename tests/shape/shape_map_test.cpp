#include "firmware/shape/shape_map.h"

#include <doctest/doctest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "firmware/input_error.h"
#include "firmware/shape/map_measures.h"
#include "tests/random.h"

using namespace finsight;

namespace {

constexpr std::size_t kCoordinates = 3 * 40;

/// A map of random numbers.
struct RandomMap {
  explicit RandomMap(int the_rank) : rank(the_rank) {
    test::Random random(1);
    const auto fill = [&](std::vector<float>& values, std::size_t count) {
      for (std::size_t i = 0; i < count; ++i) values.push_back(static_cast<float>(random.normal()));
    };
    fill(rest, kCoordinates);
    fill(scale, kPoseDims);
    fill(weights, static_cast<std::size_t>(rank) * ShapeMapModel::kFeatures);
    fill(basis, static_cast<std::size_t>(rank) * kCoordinates);
    fill(numbers, kPoseDims);
  }
  ShapeMapModel map() const { return {rank, scale, weights, basis}; }
  ShapeModel shape() const {
    ShapeModel model;
    model.nodes = static_cast<int>(rest.size() / 3);
    model.rest_mm = rest;
    return model;
  }
  ShapeMeasures measure(const std::vector<std::int32_t>& front) const {
    ShapeModel model = shape();
    model.front_nodes = front;
    const ShapeMap shape_map(map(), model);
    return MapMeasures(map(), model).measure(shape_map.coefficients(Eigen::Map<const PoseVector>(numbers.data())));
  }
  std::vector<float> evaluate() const {
    std::vector<float> node_mm(kCoordinates, -1.0f);
    ShapeMap(map(), shape()).evaluate(Eigen::Map<const PoseVector>(numbers.data()), node_mm);
    return node_mm;
  }
  int rank;
  std::vector<float> rest, scale, weights, basis, numbers;
};

Eigen::VectorXd vector(const std::vector<float>& values) {
  return Eigen::Map<const Eigen::VectorXf>(values.data(), static_cast<Eigen::Index>(values.size())).cast<double>();
}

Eigen::MatrixXd rows(const std::vector<float>& values, int count) {
  using Matrix = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  return Eigen::Map<const Matrix>(values.data(), count, static_cast<Eigen::Index>(values.size()) / count)
      .cast<double>();
}

}  // namespace

TEST_CASE("shape map: equals rest plus basis times weights times features") {
  const RandomMap random(5);
  const Eigen::VectorXd x = vector(random.numbers).cwiseProduct(vector(random.scale));
  Eigen::VectorXd features(ShapeMapModel::kFeatures);
  features << 1, x, Eigen::VectorXd::Zero(171);
  int at = 19;
  for (int i = 0; i < kPoseDims; ++i)
    for (int j = i; j < kPoseDims; ++j) features[at++] = x[i] * x[j];
  REQUIRE(at == ShapeMapModel::kFeatures);
  const Eigen::VectorXd expected =
      vector(random.rest) + rows(random.basis, 5).transpose() * (rows(random.weights, 5) * features);
  CHECK((vector(random.evaluate()) - expected).norm() < 1e-5 * expected.norm());
}

TEST_CASE("shape map: without a basis it gives the finger at rest") {
  const RandomMap random(0);
  CHECK(random.evaluate() == random.rest);
}

TEST_CASE("shape map: refuses sizes that do not fit the shape") {
  const std::pair<std::vector<float> RandomMap::*, const char*> parts[] = {
      {&RandomMap::scale, "scale: found 17 numbers, expected 18"},
      {&RandomMap::weights, "weights: found 569 numbers, expected 570"},
      {&RandomMap::basis, "basis: found 359 numbers, expected 360"}};
  for (const auto& [part, message] : parts) {
    RandomMap random(3);
    (random.*part).pop_back();
    CHECK_THROWS_WITH_AS(random.evaluate(), doctest::Contains(message), InputError);
  }
}

TEST_CASE("shape map: measures without the shape what the shape measures") {
  const std::vector<std::int32_t> front = {3, 4, 17, 39};
  for (const int rank : {0, 1, 20}) {
    RandomMap random(rank);
    CAPTURE(rank);
    for (int turn = 0; turn < 20; ++turn) {
      for (float& number : random.numbers) number = 0.5f * number + 0.1f * static_cast<float>(turn);
      const ShapeMeasures wanted = measure_shape<float>(random.rest, front, random.evaluate());
      const ShapeMeasures measures = random.measure(front);
      CHECK(measures.rms_mm == doctest::Approx(wanted.rms_mm).epsilon(1e-4));
      CHECK(measures.front_rms_mm == doctest::Approx(wanted.front_rms_mm).epsilon(1e-4));
      CHECK(measures.largest_mm == doctest::Approx(wanted.largest_mm).epsilon(1e-4));
    }
  }
}

TEST_CASE("shape measures: are root mean squares of all and of the front nodes, and the largest") {
  const std::vector<float> rest = {0, 0, 0, 1, 1, 1, 2, 2, 2}, moved = {3, 4, 0, 1, 1, 1, 2, 2, 14};
  const std::vector<std::int32_t> front = {0, 1};
  const ShapeMeasures measures = measure_shape<float>(rest, front, moved);
  CHECK(measures.rms_mm == doctest::Approx(std::sqrt(169.0 / 3)));
  CHECK(measures.front_rms_mm == doctest::Approx(std::sqrt(12.5)));
  CHECK(measures.largest_mm == doctest::Approx(12));
}
