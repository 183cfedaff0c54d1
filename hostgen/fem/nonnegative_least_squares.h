#pragma once

#include <Eigen/Core>

namespace finsight::host {

/// min |A x - b| over x >= 0 (Lawson and Hanson 1974).
Eigen::VectorXd nonnegative_least_squares(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);

}  // namespace finsight::host
