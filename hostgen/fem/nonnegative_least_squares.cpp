#include "hostgen/fem/nonnegative_least_squares.h"

#include <Eigen/QR>
#include <algorithm>
#include <vector>

namespace finsight::host {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

VectorXd nonnegative_least_squares(const MatrixXd& A, const VectorXd& b) {
  const Index n = A.cols();
  VectorXd x = VectorXd::Zero(n);
  std::vector<Index> passive;  // free columns; the others are held at zero
  VectorXd pull = A.transpose() * b;
  const double nothing = n == 0 ? 0 : 1e-10 * pull.cwiseAbs().maxCoeff();
  const auto solve = [&] { return VectorXd(MatrixXd(A(Eigen::all, passive)).colPivHouseholderQr().solve(b)); };
  for (Index round = 0; round < 3 * n; ++round) {
    for (const Index j : passive) pull[j] = 0;
    Index enter = 0;
    if (pull.maxCoeff(&enter) <= nothing) break;
    passive.push_back(enter);
    VectorXd best = solve();
    while (best.minCoeff() <= 0) {
      // Goes towards it as far as nothing turns negative; what reached zero is held there.
      double share = 1;
      for (std::size_t k = 0; k < passive.size(); ++k) {
        const double from = x[passive[k]], to = best[static_cast<Index>(k)];
        if (to <= 0) share = std::min(share, from / (from - to));
      }
      std::vector<Index> still;
      for (std::size_t k = 0; k < passive.size(); ++k) {
        const double from = x[passive[k]], to = best[static_cast<Index>(k)];
        const bool held = to <= 0 && from / (from - to) <= share;
        x[passive[k]] = held ? 0 : from + share * (to - from);
        if (!held) still.push_back(passive[k]);
      }
      passive = std::move(still);
      if (passive.empty()) break;
      best = solve();
    }
    for (std::size_t k = 0; k < passive.size(); ++k) x[passive[k]] = best[static_cast<Index>(k)];
    pull = A.transpose() * (b - A * x);
  }
  return x;
}

}  // namespace finsight::host
