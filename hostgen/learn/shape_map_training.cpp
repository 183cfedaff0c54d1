#include "hostgen/learn/shape_map_training.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "hostgen/learn/shape_truth.h"
#include "hostgen/util/random.h"

namespace finsight::host {

namespace {

// Relative to the mean size of a feature. Small enough to recover an exact quadratic map to 1e-4 of its size.
constexpr double kRidge = 1e-6;

// The leading right singular vectors as rows, by subspace iteration (Halko et al. 2011): the spectrum falls fast, so
// a few iterations with some spare vectors are exact to float precision.
Eigen::MatrixXd leading_directions(const Eigen::MatrixXd& samples, int rank) {
  constexpr int kSpare = 10, kRounds = 8;
  const int width = static_cast<int>(std::min<Eigen::Index>({rank + kSpare, samples.rows(), samples.cols()}));
  Random random(1);
  Eigen::MatrixXd directions(samples.cols(), width);
  for (double& value : directions.reshaped()) value = random.normal();
  for (int round = 0; round < kRounds; ++round) {
    const Eigen::MatrixXd images = samples.transpose() * (samples * directions);
    const Eigen::HouseholderQR<Eigen::MatrixXd> qr(images);
    directions = qr.householderQ() * Eigen::MatrixXd::Identity(samples.cols(), width);
  }
  const Eigen::MatrixXd projected = samples * directions;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(projected.transpose() * projected);  // ascending
  const Eigen::MatrixXd turn = solver.eigenvectors().rowwise().reverse().leftCols(rank);
  return (directions * turn).transpose();
}

// One over the largest magnitude of each number. The smallest allowed magnitude is relative to the largest displacement
// or rotation, so that a number that hardly moves is not blown up.
std::vector<float> pose_scale(const Eigen::MatrixXf& poses) {
  constexpr float kSmallest = 0.05f;
  std::vector<float> largest(kPoseDims);
  float of_kind[2] = {0, 0};
  for (std::size_t i = 0; i < kPoseDims; ++i) {
    largest[i] = poses.col(static_cast<int>(i)).cwiseAbs().maxCoeff();
    of_kind[i % 6 / 3] = std::max(of_kind[i % 6 / 3], largest[i]);
  }
  std::vector<float> scale(kPoseDims);
  for (std::size_t i = 0; i < kPoseDims; ++i) {
    const float size = std::max(largest[i], kSmallest * of_kind[i % 6 / 3]);
    scale[i] = size > 0 ? 1.0f / size : 1.0f;
  }
  return scale;
}

// The features of ShapeMapModel without the constant one.
Eigen::MatrixXd features(const Eigen::MatrixXf& poses, const std::vector<float>& scale) {
  const Eigen::Map<const Eigen::RowVectorXf> factors(scale.data(), kPoseDims);
  const Eigen::MatrixXd x = (poses.array().rowwise() * factors.array()).matrix().cast<double>();
  Eigen::MatrixXd result(poses.rows(), ShapeMapModel::kFeatures - 1);
  result.leftCols(kPoseDims) = x;
  int column = kPoseDims;
  for (int i = 0; i < kPoseDims; ++i) {
    for (int j = i; j < kPoseDims; ++j) result.col(column++) = x.col(i).cwiseProduct(x.col(j));
  }
  return result;
}

}  // namespace

ShapeMapModel ShapeMapData::view() const { return {rank, scale, weights, basis}; }

ShapeMapData fit_shape_map(const Eigen::MatrixXf& poses, const Eigen::MatrixXf& displacement_mm, int rank) {
  if (poses.cols() != kPoseDims || poses.rows() != displacement_mm.rows() || poses.rows() < 1 || rank < 1 ||
      rank > std::min(displacement_mm.rows(), displacement_mm.cols())) {
    throw std::invalid_argument(
        "shape map: expected 18 plate numbers and one displacement per sample, and a rank from 1 to the number of "
        "samples");
  }
  ShapeMapData map;
  map.rank = rank;
  map.scale = pose_scale(poses);
  const Eigen::MatrixXd displacements = displacement_mm.cast<double>();
  const Eigen::MatrixXd basis = leading_directions(displacements, rank);

  const Eigen::MatrixXd x = features(poses, map.scale);
  const Eigen::MatrixXd coordinates = displacements * basis.transpose();
  Eigen::MatrixXd normal = x.transpose() * x;
  normal.diagonal().array() += kRidge * std::max(normal.trace() / static_cast<double>(normal.rows()), 1e-30);
  const Eigen::MatrixXd weights = normal.ldlt().solve(x.transpose() * coordinates).transpose();  // [rank, features - 1]

  for (int r = 0; r < rank; ++r) {
    map.weights.push_back(0.0f);  // the constant feature: no motion must give exactly no displacement
    for (const double weight : weights.row(r)) map.weights.push_back(static_cast<float>(weight));
    for (const double component : basis.row(r)) map.basis.push_back(static_cast<float>(component));
  }
  return map;
}

// A dimple is small compared with the bend, so shapes with one need more basis vectors.
ShapeMapData fit_contact_map(const FingerSpec& spec, const FemDataset& dataset, std::uint64_t seed) {
  constexpr int kNoisyCopies = 2;
  constexpr Eigen::Index kRank = 40;
  const ShapeSamples samples = contact_shapes(spec, dataset, kNoisyCopies, seed);
  return fit_shape_map(samples.poses, samples.displacement_mm,
                       static_cast<int>(std::min({kRank, samples.poses.rows(), samples.displacement_mm.cols()})));
}

}  // namespace finsight::host
