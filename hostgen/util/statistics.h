// Error statistics.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace finsight::host {

/// Value below which `share` (0 to 1) of the numbers lie; `none` if there are none.
inline double quantile(std::vector<double> numbers, double share, double none = 0) {
  if (numbers.empty()) return none;
  const auto rank = static_cast<std::ptrdiff_t>(share * static_cast<double>(numbers.size() - 1) + 0.5);
  std::nth_element(numbers.begin(), numbers.begin() + rank, numbers.end());
  return numbers[static_cast<std::size_t>(rank)];
}

/// Value below which the sum of squares of `numbers` standard normal numbers stays as probably as one of them stays
/// below `z` (1.645: 95 %, 3.09: 99.9 %). Wilson and Hilferty 1931; within 1 % for 6 numbers or more.
inline double chi_squared_quantile(double numbers, double z) {
  const double ninth = 2 / (9 * numbers);
  return numbers * std::pow(1 - ninth + z * std::sqrt(ninth), 3);
}

/// What was counted of one group.
struct GroupCount {
  double inside = 0, all = 0;
};
/// Standard error of the share of all groups together that is inside, where the members of a group err alike: several
/// measurements at one place tell hardly more of other places than one of them (ratio estimator; Cochran, Sampling
/// Techniques, 1977, section 6.3). 0 for fewer than two groups.
inline double share_error(const std::vector<GroupCount>& groups) {
  double inside = 0, all = 0, square = 0;
  for (const GroupCount& group : groups) {
    inside += group.inside;
    all += group.all;
  }
  const auto count = static_cast<double>(groups.size());
  if (count < 2 || all <= 0) return 0;
  for (const GroupCount& group : groups) {
    const double more = group.inside - inside / all * group.all;
    square += more * more;
  }
  return std::sqrt(square * count / (count - 1)) / all;
}

/// Per axis: root mean square error, and R2 = 1 - squared error / variance of the truth (0 where the truth is
/// constant).
struct AxisErrors {
  std::array<double, 3> rmse_mm{}, r2{};
};
/// Columns are samples, [3, samples].
inline AxisErrors axis_errors(const Eigen::Matrix3Xd& truth_mm, const Eigen::Matrix3Xd& error_mm) {
  AxisErrors result;
  for (int i = 0; i < 3; ++i) {
    const double variance = (truth_mm.row(i).array() - truth_mm.row(i).mean()).square().mean();
    const double square = error_mm.row(i).array().square().mean();
    result.rmse_mm[static_cast<std::size_t>(i)] = std::sqrt(square);
    result.r2[static_cast<std::size_t>(i)] = variance > 0 ? 1 - square / variance : 0;
  }
  return result;
}

}  // namespace finsight::host
