#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SparseCholesky>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>
#include <vector>

#include "firmware/shape/soft_newton.h"
#include "hostgen/bench/iteration.h"
#include "hostgen/bench/second_order.h"
#include "hostgen/util/stopwatch.h"

namespace finsight::host {

namespace {

using Matrix12 = Eigen::Matrix<double, 12, 12>;

/// The finger as the published program sees it: every tetrahedron counts, all nodes but the base's are free.
class PublishedFinger {
 public:
  PublishedFinger(const ShapeModel& soft, std::span<const double> node_mm)
      : soft_(soft), x_(node_mm.begin(), node_mm.end()), tets_(static_cast<std::size_t>(soft.tets)) {
    for (std::size_t t = 0; t < tets_.size(); ++t) {
      Eigen::Matrix<double, 3, 3, Eigen::RowMajor> edges;
      for (int c = 0; c < 3; ++c) {
        for (int r = 0; r < 3; ++r) {
          edges(r, c) = static_cast<double>(soft.rest_mm[3 * soft.tet_nodes[4 * t + c + 1] + r]) -
                        static_cast<double>(soft.rest_mm[3 * soft.tet_nodes[4 * t] + r]);
        }
      }
      tets_[t] = edges.inverse();
    }
    unknowns_ = 3 * soft.cholesky.blocks;
  }

  void derivatives() {
    entries_.clear();
    gradient_.setZero(unknowns_);
    for (std::size_t t = 0; t < tets_.size(); ++t) add_tet(t);
    // Springs hold the plates where they are: the shape is that of a frame's last iteration.
    for (int node = 0; node < soft_.nodes; ++node) {
      if (soft_.node_kind[node] < 2) continue;
      for (int d = 0; d < 3; ++d) {
        const int i = 3 * soft_.free_index[node] + d;
        entries_.emplace_back(i, i, 2 * SoftNewtonSolver<double>::kPublishedOmega);
      }
    }
    hessian_.resize(unknowns_, unknowns_);
    hessian_.setFromTriplets(entries_.begin(), entries_.end());
  }

  bool factor() {
    solver_ = std::make_unique<Solver>(hessian_);
    return solver_->info() == Eigen::Success;
  }
  void solve() { step_ = solver_->solve(-gradient_); }

  /// After the whole step: the first try of the line search.
  double energy_after_step() const {
    double sum = 0;
    for (std::size_t t = 0; t < tets_.size(); ++t) {
      Eigen::Matrix3d edges;
      for (int c = 0; c < 3; ++c) edges.col(c) = stepped(t, c + 1) - stepped(t, 0);
      const Eigen::Matrix3d F = edges * tets_[t];
      if (!(F.determinant() > 0)) return std::numeric_limits<double>::infinity();
      sum += F.squaredNorm() + F.inverse().squaredNorm();
    }
    return sum;
  }

 private:
  using Solver = Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>;

  int unknown(std::size_t tet, int corner) const { return soft_.free_index[soft_.tet_nodes[4 * tet + corner]]; }
  Eigen::Vector3d stepped(std::size_t tet, int corner) const {
    const Eigen::Vector3d at = Eigen::Map<const Eigen::Vector3d>(&x_[3 * soft_.tet_nodes[4 * tet + corner]]);
    const int node = unknown(tet, corner);
    return node < 0 ? at : Eigen::Vector3d(at + step_.segment<3>(3 * node));
  }

  void add_tet(std::size_t t) {
    double x[12];
    for (int corner = 0; corner < 4; ++corner) {
      for (int d = 0; d < 3; ++d) x[3 * corner + d] = x_[3 * soft_.tet_nodes[4 * t + corner] + d];
    }
    const SecondOrder<12> energy = dirichlet_by_differentiation(x, tets_[t].data());
    const Eigen::SelfAdjointEigenSolver<Matrix12> eigen(energy.hessian);
    const Matrix12 H =
        eigen.eigenvectors() * eigen.eigenvalues().cwiseMax(0).asDiagonal() * eigen.eigenvectors().transpose();
    for (int a = 0; a < 12; ++a) {
      const int i = unknown(t, a / 3);
      if (i < 0) continue;
      gradient_[3 * i + a % 3] += energy.gradient[a];
      for (int b = 0; b < 12; ++b) {
        const int j = unknown(t, b / 3);
        if (j >= 0) entries_.emplace_back(3 * i + a % 3, 3 * j + b % 3, H(a, b));
      }
    }
  }

  const ShapeModel soft_;
  std::vector<double> x_;
  std::vector<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> tets_;  // inverse of the undeformed edges
  int unknowns_ = 0;
  std::vector<Eigen::Triplet<double>> entries_;
  Eigen::SparseMatrix<double> hessian_;
  Eigen::VectorXd gradient_, step_;
  std::unique_ptr<Solver> solver_;
};

}  // namespace

Iteration published_iteration(const ShapeModel& soft, std::span<const double> node_mm) {
  const auto finger = std::make_shared<PublishedFinger>(soft, node_mm);
  return [finger] {
    IterationTime time;
    ProcessorStopwatch watch;
    finger->derivatives();
    time.derivatives_us = watch.lap_us();
    if (!finger->factor()) throw std::runtime_error("bench: the published method's factorisation fails");
    time.factor_us = watch.lap_us();
    finger->solve();
    time.solve_us = watch.lap_us();
    if (!std::isfinite(finger->energy_after_step())) throw std::runtime_error("bench: the published step inverts");
    time.step_us = watch.lap_us();
    return time;
  };
}

}  // namespace finsight::host
