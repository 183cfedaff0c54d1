#include "hostgen/fem/nonnegative_least_squares.h"

#include <doctest/doctest.h>

#include "firmware/types.h"
#include "hostgen/util/random.h"

using namespace finsight::host;
using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using finsight::kPoseDims;

namespace {

MatrixXd random_matrix(Random& random, Index rows, Index cols) {
  MatrixXd matrix(rows, cols);
  for (Index j = 0; j < cols; ++j) {
    for (Index i = 0; i < rows; ++i) matrix(i, j) = random.normal();
  }
  return matrix;
}

}  // namespace

TEST_CASE("nonnegative least squares: the optimality conditions hold") {
  Random random(3);
  for (int round = 0; round < 20; ++round) {
    const MatrixXd A = random_matrix(random, kPoseDims, 40);
    const VectorXd b = random_matrix(random, kPoseDims, 1), x = nonnegative_least_squares(A, b);
    const VectorXd pull = A.transpose() * (b - A * x);
    CHECK(x.minCoeff() >= 0);
    CHECK(pull.maxCoeff() < 1e-8);                             // raising a zero entry does not help
    CHECK(pull.cwiseProduct(x).cwiseAbs().maxCoeff() < 1e-8);  // nor does changing a positive one
    CHECK((b - A * x).norm() < b.norm());
  }
}
