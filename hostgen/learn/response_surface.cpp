#include "hostgen/learn/response_surface.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "hostgen/learn/state_interpolant.h"

namespace finsight::host {

namespace {

using Numbers = PoseVectorOf<double>;

constexpr double kRidge = 1e-4;  // of a feature's mean square
// Below, more terms follow the states they were fitted to and miss others.
constexpr std::size_t kStatesPerTerm = 8;

/// Least squares with a penalty; every feature is first scaled to a mean square of 1. [features, outputs]
Eigen::MatrixXd ridge(Eigen::MatrixXd features, const Eigen::MatrixXd& outputs) {
  const auto rows = static_cast<double>(features.rows());
  const Eigen::RowVectorXd scale = (features.array().square().colwise().mean().sqrt() + 1e-12).inverse();
  features = features * scale.asDiagonal();
  Eigen::MatrixXd squares = features.transpose() * features / rows;
  squares.diagonal().array() += kRidge;
  return scale.asDiagonal() * squares.ldlt().solve(features.transpose() * outputs / rows).eval();
}

}  // namespace

std::size_t ResponseSurface::Terms::count() const {
  const auto n2 = static_cast<std::size_t>(second), n3 = static_cast<std::size_t>(third),
             n4 = static_cast<std::size_t>(fourth);
  return n2 * (n2 + 1) / 2 + n3 * (n3 + 1) * (n3 + 2) / 6 + n4 * (n4 + 1) * (n4 + 2) * (n4 + 3) / 24;
}

Eigen::VectorXd ResponseSurface::directions(const PoseVector& linear) const {
  return to_directions_ * linear.cast<double>();
}

Eigen::VectorXd ResponseSurface::products(const Eigen::VectorXd& x) const {
  Eigen::VectorXd values(static_cast<Eigen::Index>(terms_.count()));
  Eigen::Index next = 0;
  for (int a = 0; a < terms_.second; ++a) {
    for (int b = a; b < terms_.second; ++b) {
      const double ab = x[a] * x[b];
      values[next++] = ab;
      for (int c = b; b < terms_.third && c < terms_.third; ++c) {
        values[next++] = ab * x[c];
        for (int d = c; c < terms_.fourth && d < terms_.fourth; ++d) values[next++] = ab * x[c] * x[d];
      }
    }
  }
  return values;
}

ResponseSurface::ResponseSurface(const std::vector<FemState>& states, const std::array<PoseNoise, kPlates>& noise) {
  std::vector<const FemState*> valid;
  for (const FemState& state : states) {
    if (state.valid()) valid.push_back(&state);
  }
  for (const Terms& terms :
       {Terms{kPoseDims, 10, 8}, {kPoseDims, 8, 6}, {kPoseDims, 6, 4}, {10, 5, 0}, {5, 0, 0}, {2, 0, 0}}) {
    terms_ = terms;
    if (valid.size() >= kStatesPerTerm * terms.count()) break;
  }
  const auto count = static_cast<Eigen::Index>(valid.size());
  if (valid.size() < kStatesPerTerm * terms_.count()) {
    throw std::runtime_error("training set: " + std::to_string(valid.size()) +
                             " states in equilibrium are too few for the scene; " +
                             std::to_string(kStatesPerTerm * terms_.count()) + " are needed");
  }
  const Numbers by_noise = pose_noise(noise).cwiseInverse();
  Eigen::MatrixXd linear(count, kPoseDims), added(count, kPoseDims), displacement(count, 3);
  for (Eigen::Index i = 0; i < count; ++i) {
    const FemState& state = *valid[static_cast<std::size_t>(i)];
    linear.row(i) = state.linear.cast<double>();
    added.row(i) = (touch_sample(state).numbers - state.linear).cast<double>();
    displacement.row(i) = (state.contact_mm - state.point_mm).cast<double>();
  }
  const Eigen::MatrixXd whitened = linear * by_noise.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> spread(whitened.transpose() * whitened /
                                                              static_cast<double>(count));  // ascending
  for (int i = 0; i < kPoseDims; ++i) {
    const Eigen::Index column = kPoseDims - 1 - i;
    to_directions_.row(i) = spread.eigenvectors().col(column).transpose() * by_noise.asDiagonal() /
                            std::sqrt(std::max(spread.eigenvalues()[column], 1e-12));
  }
  Eigen::MatrixXd features(count, kPoseDims + static_cast<Eigen::Index>(terms_.count()));
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::VectorXd x = directions(valid[static_cast<std::size_t>(i)]->linear);
    features.row(i).head<kPoseDims>() = x;
    features.row(i).tail(features.cols() - kPoseDims) = products(x);
  }
  added_ = ridge(features.rightCols(features.cols() - kPoseDims), added);
  displacement_ = ridge(features, displacement);
}

PoseVector ResponseSurface::poses(const PoseVector& linear) const {
  return linear + (added_.transpose() * products(directions(linear))).cast<float>();
}

Vec3f ResponseSurface::displacement_mm(const PoseVector& linear) const {
  const Eigen::VectorXd x = directions(linear);
  return (displacement_.topRows<kPoseDims>().transpose() * x +
          displacement_.bottomRows(displacement_.rows() - kPoseDims).transpose() * products(x))
      .cast<float>();
}

}  // namespace finsight::host
