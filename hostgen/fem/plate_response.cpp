// Letters: as in the header. "~" marks what single precision gives: W~ = K~^-1 A^T. The softest motions are all among
// W~'s columns, as their combinations with the largest displacements: Z. Within their span the errors of K~^-1 are
// taken back (a coarse space, as of two-level preconditioners): K^-1 b = x + Z (Z^T K Z)^-1 Z^T (b - K x), x = K~^-1 b.
#include "hostgen/fem/plate_response.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>

namespace finsight::host {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index kSoftest = 6;

Eigen::Map<const VectorXd> as_vector(std::span<const double> v) { return {v.data(), static_cast<Index>(v.size())}; }
std::span<double> as_span(Eigen::Ref<VectorXd> v) { return {v.data(), static_cast<std::size_t>(v.size())}; }

}  // namespace

PlateResponse::PlateResponse(const ElasticBody& body, Equilibrium& equilibrium)
    : body_(body), equilibrium_(equilibrium) {}

// K is symmetric, so a solve per direction serves all forces.
bool PlateResponse::linearise(const ElasticState& state, const PlateErrors& errors, const MatrixXd& directions) {
  if (!equilibrium_.linearise(state)) return false;
  const auto size = static_cast<Index>(body_.vector_size());
  directions_ = directions;
  Equilibrium::Columns right(size, directions.cols());
  VectorXd column(size);
  for (Index i = 0; i < directions.cols(); ++i) {
    errors.transpose(directions.col(i), as_span(column));
    right.col(i) = column;
  }
  W_ = right;
  equilibrium_.apply_inverse(W_);
  const MatrixXd squares = W_.transpose() * W_;
  const Eigen::SelfAdjointEigenSolver<MatrixXd> motions(squares);
  const Index count = std::min(kSoftest, directions.cols());
  const VectorXd scale = motions.eigenvalues().tail(count).cwiseSqrt().cwiseInverse();
  Z_ = W_ * (motions.eigenvectors().rightCols(count) * scale.asDiagonal());
  KZ_.resize(size, count);
  for (Index i = 0; i < count; ++i) {
    body_.times_tangent(state.u, state.stress, as_span(Z_.col(i)), as_span(KZ_.col(i)));
  }
  KZ_.bottomRows<3>().setZero();
  const MatrixXd stiffness = Z_.transpose() * KZ_;
  compliance_ = (0.5 * (stiffness + stiffness.transpose())).ldlt().solve(MatrixXd::Identity(count, count));
  const MatrixXd left = Z_.transpose() * right - KZ_.transpose() * W_;
  W_ += Z_ * (compliance_ * left);
  return true;
}

void PlateResponse::solve(std::span<double> b) const {
  const VectorXd along = Z_.transpose() * as_vector(b);
  equilibrium_.apply_inverse(b);
  const VectorXd wrong = compliance_ * (along - KZ_.transpose() * as_vector(b));
  Eigen::Map<VectorXd>(b.data(), static_cast<Index>(b.size())) += Z_ * wrong;
}

VectorXd PlateResponse::of(std::span<const double> force_n) const {
  return directions_ * (W_.transpose() * as_vector(force_n));
}

VectorXd PlateResponse::of(const FacePoint& at) const {
  VectorXd sum = VectorXd::Zero(W_.cols());
  for (std::size_t i = 0; i < at.node.size(); ++i) {
    const Index row = 3 * body_.unknown_of_node()[static_cast<std::size_t>(at.node[i])];
    sum.noalias() += W_.middleRows<3>(row).transpose() * (at.weight[i] * at.inward);
  }
  return directions_ * sum;
}

}  // namespace finsight::host
