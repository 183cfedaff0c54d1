#include "hostgen/learn/shape_map_training.h"

#include <doctest/doctest.h>

#include <Eigen/SVD>
#include <stdexcept>

#include "hostgen/util/random.h"

using namespace finsight;
using namespace finsight::host;

namespace {

// The formula of ShapeMapModel, written from its docstring.
Eigen::VectorXf answer(const ShapeMapModel& map, const Eigen::VectorXf& pose) {
  std::vector<float> x, features = {1};
  for (int i = 0; i < kPoseDims; ++i) x.push_back(map.scale[std::size_t(i)] * pose[i]);
  features.insert(features.end(), x.begin(), x.end());
  for (std::size_t i = 0; i < kPoseDims; ++i) {
    for (std::size_t j = i; j < kPoseDims; ++j) features.push_back(x[i] * x[j]);
  }
  REQUIRE(features.size() == std::size_t(ShapeMapModel::kFeatures));
  const std::size_t size = map.basis.size() / std::size_t(map.rank);
  Eigen::VectorXf displacement = Eigen::VectorXf::Zero(Eigen::Index(size));
  for (std::size_t r = 0; r < std::size_t(map.rank); ++r) {
    float coordinate = 0;
    for (std::size_t f = 0; f < features.size(); ++f) coordinate += map.weights[r * features.size() + f] * features[f];
    for (std::size_t i = 0; i < size; ++i) displacement[Eigen::Index(i)] += coordinate * map.basis[r * size + i];
  }
  return displacement;
}

// Displacements that are an exact linear + quadratic function of the pose, in a space of `rank` dimensions.
struct QuadraticFinger {
  Eigen::MatrixXf linear, quadratic, directions;
  QuadraticFinger(int rank, int nodes, Random& random) {
    linear = random_matrix(rank, kPoseDims, random);
    quadratic = 0.1f * random_matrix(rank, kPoseDims * kPoseDims, random);
    directions = random_matrix(3 * nodes, rank, random);
  }
  static Eigen::MatrixXf random_matrix(int rows, int cols, Random& random) {
    Eigen::MatrixXf matrix(rows, cols);
    for (float& value : matrix.reshaped()) value = float(random.normal());
    return matrix;
  }
  Eigen::VectorXf displacement(const Eigen::VectorXf& pose) const {
    const Eigen::MatrixXf products = pose * pose.transpose();
    return directions * (linear * pose + quadratic * products.reshaped());
  }
};

Eigen::VectorXf random_pose(Random& random) {
  Eigen::VectorXf pose(kPoseDims);
  for (int i = 0; i < kPoseDims; ++i) pose[i] = float(random.normal()) * (i % 6 < 3 ? 3.0f : 0.1f);
  return pose;
}

struct Samples {
  Eigen::MatrixXf poses, displacement_mm;
};
Samples draw(const QuadraticFinger& finger, int count, Random& random) {
  Samples samples{Eigen::MatrixXf(count, kPoseDims), Eigen::MatrixXf(count, finger.directions.rows())};
  for (int s = 0; s < count; ++s) {
    const Eigen::VectorXf pose = random_pose(random);
    samples.poses.row(s) = pose.transpose();
    samples.displacement_mm.row(s) = finger.displacement(pose).transpose();
  }
  return samples;
}

}  // namespace

TEST_CASE("shape map: an exact quadratic map is recovered") {
  Random random(4);
  const QuadraticFinger finger(5, 40, random);
  const Samples samples = draw(finger, 600, random);
  const ShapeMapData map = fit_shape_map(samples.poses, samples.displacement_mm, 5);
  CHECK(map.rank == 5);
  for (int s = 0; s < 20; ++s) {
    const Eigen::VectorXf pose = random_pose(random);
    const Eigen::VectorXf expected = finger.displacement(pose);
    CHECK((answer(map.view(), pose) - expected).norm() < 1e-3f * expected.norm());
  }
}

TEST_CASE("shape map: no motion is exactly no displacement, because the constant's weights are zero") {
  Random random(5);
  const QuadraticFinger finger(4, 20, random);
  Samples samples = draw(finger, 100, random);
  samples.displacement_mm.array() += 0.3f;  // an offset that a constant would absorb
  const ShapeMapData map = fit_shape_map(samples.poses, samples.displacement_mm, 4);
  for (std::size_t r = 0; r < 4; ++r) CHECK(map.weights[r * ShapeMapModel::kFeatures] == 0);
  CHECK(answer(map.view(), Eigen::VectorXf::Zero(kPoseDims)).norm() == 0);
}

TEST_CASE("shape map: the basis is orthonormal and spans what a dense singular value decomposition finds") {
  Random random(6);
  const int samples = 90, size = 60, rank = 6;
  Eigen::MatrixXf displacement = QuadraticFinger::random_matrix(samples, size, random);
  for (int i = 0; i < size; ++i) displacement.col(i) *= std::pow(0.7f, float(i));  // a decaying spectrum
  Eigen::MatrixXf poses(samples, kPoseDims);
  for (int s = 0; s < samples; ++s) poses.row(s) = random_pose(random).transpose();
  const ShapeMapData map = fit_shape_map(poses, displacement, rank);
  const Eigen::MatrixXf basis =
      Eigen::Map<const Eigen::Matrix<float, -1, -1, Eigen::RowMajor>>(map.basis.data(), rank, size);
  CHECK((basis * basis.transpose() - Eigen::MatrixXf::Identity(rank, rank)).norm() < 1e-4f);
  const Eigen::JacobiSVD<Eigen::MatrixXf> svd(displacement, Eigen::ComputeThinV);
  for (int r = 0; r < rank; ++r) CHECK(std::abs(basis.row(r).dot(svd.matrixV().col(r))) > 0.999f);
}

TEST_CASE("shape map: copes with a plate number that never moves, and with a finger that never moves") {
  Random random(7);
  const QuadraticFinger finger(3, 15, random);
  Samples samples = draw(finger, 300, random);
  samples.poses.col(4).setZero();
  const ShapeMapData map = fit_shape_map(samples.poses, samples.displacement_mm, 3);
  for (const float number : map.weights) CHECK(std::isfinite(number));
  CHECK(map.scale[4] < 100);
  const ShapeMapData still = fit_shape_map(Eigen::MatrixXf::Zero(30, kPoseDims), Eigen::MatrixXf::Zero(30, 45), 3);
  for (const float number : still.weights) CHECK(number == 0);
  for (const float number : still.basis) CHECK(std::isfinite(number));
}

TEST_CASE("shape map: refuses matrices whose sizes do not agree") {
  CHECK_THROWS_AS(fit_shape_map(Eigen::MatrixXf::Zero(30, 17), Eigen::MatrixXf::Zero(30, 45), 3),
                  std::invalid_argument);
  CHECK_THROWS_AS(fit_shape_map(Eigen::MatrixXf::Zero(29, kPoseDims), Eigen::MatrixXf::Zero(30, 45), 3),
                  std::invalid_argument);
  CHECK_THROWS_AS(fit_shape_map(Eigen::MatrixXf::Zero(10, kPoseDims), Eigen::MatrixXf::Zero(10, 45), 11),
                  std::invalid_argument);
}

TEST_CASE("shape map: the same samples give the same bytes") {
  Random random(8);
  const QuadraticFinger finger(4, 20, random);
  const Samples samples = draw(finger, 100, random);
  const ShapeMapData a = fit_shape_map(samples.poses, samples.displacement_mm, 4);
  const ShapeMapData b = fit_shape_map(samples.poses, samples.displacement_mm, 4);
  CHECK(a.weights == b.weights);
  CHECK(a.basis == b.basis);
}
