#include "hostgen/learn/state_interpolant.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>

namespace finsight::host {

namespace {

constexpr int kMinPoints = 10;
// Scales coordinates to about one, for the condition of the spline's system.
constexpr double kLength_mm = 50.0;
// Far below the accuracy of the states; allows two paths to share a contact point.
constexpr double kSmoothing = 1e-7;

double thin_plate(double distance_sq) { return distance_sq > 0 ? 0.5 * distance_sq * std::log(distance_sq) : 0.0; }

}  // namespace

TouchSample touch_sample(const FemState& state) {
  TouchSample sample;
  for (std::size_t p = 0; p < kPlates; ++p) {
    sample.numbers.segment<3>(6 * static_cast<int>(p)) = state.plates[p].displacement_mm;
    sample.numbers.segment<3>(6 * static_cast<int>(p) + 3) = state.plates[p].rotation_rad;
  }
  sample.point_mm = state.point_mm;
  sample.displacement_mm = state.contact_mm - state.point_mm;
  sample.force_n = state.force_n;
  sample.force_vector_n = state.force_vector_n;
  sample.moment_nm = state.moment_nmm / static_cast<float>(kNmmPerNm);
  return sample;
}

StateInterpolant::StateInterpolant(const std::vector<FemState>& states) {
  std::map<float, std::vector<const FemState*>> by_force;
  std::map<std::int32_t, std::array<double, 3>> highest;
  for (const FemState& state : states) {
    if (!state.valid() || !(state.force_n > 0)) continue;
    by_force[state.force_n].push_back(&state);
    auto& path = highest[state.path];
    path = {state.point_mm.x(), state.point_mm.y(), std::max<double>(path[2], state.force_n)};
  }
  for (const auto& [path, point] : highest) highest_.push_back(point);
  for (const auto& [force_n, members] : by_force) {
    if (members.size() < kMinPoints) continue;
    Level level;
    level.force_n = force_n;
    level.points.resize(static_cast<int>(members.size()), 2);
    level.values.resize(static_cast<int>(members.size()), kValues);
    for (int i = 0; i < level.points.rows(); ++i) {
      const TouchSample sample = touch_sample(*members[static_cast<std::size_t>(i)]);
      level.points.row(i) = sample.point_mm.head<2>().cast<double>() / kLength_mm;
      level.values.row(i).head<kPoseDims>() = sample.numbers.cast<double>() / force_n;
      level.values.row(i).segment<3>(kPoseDims) = sample.displacement_mm.cast<double>() / force_n;
      level.values.row(i).segment<3>(kPoseDims + 3) = sample.force_vector_n.cast<double>() / force_n;
      level.values.row(i).segment<3>(kPoseDims + 6) = sample.moment_nm.cast<double>() / force_n;
      level.values(i, kValues - 1) = sample.point_mm.z();
    }
    fit(level);
    levels_.push_back(std::move(level));
  }
  if (levels_.empty()) {
    throw std::runtime_error("training set: no force was computed at " + std::to_string(kMinPoints) +
                             " contact points or more; the touch network cannot be trained");
  }
}

// Thin-plate spline with a linear tail: [K P; P' 0] [w; a] = [values; 0]. The inverse also gives the error of leaving
// one point out, weights_i / inverse_ii (Rippa 1999), which needs no further fit.
void StateInterpolant::fit(Level& level) {
  const auto count = static_cast<int>(level.points.rows());
  Eigen::MatrixXd system = Eigen::MatrixXd::Zero(count + 3, count + 3);
  for (int i = 0; i < count; ++i) {
    for (int j = 0; j < count; ++j) {
      system(i, j) = thin_plate((level.points.row(i) - level.points.row(j)).squaredNorm());
    }
    system(i, i) = kSmoothing;
    system.row(i).tail<3>() << 1.0, level.points(i, 0), level.points(i, 1);
    system.col(i).tail<3>() = system.row(i).tail<3>().transpose();
  }
  const Eigen::MatrixXd inverse = system.partialPivLu().inverse();
  level.weights = inverse.leftCols(count) * level.values;
  for (int i = 0; i < count; ++i) {
    for (int p = 0; p < kPlates; ++p) {
      level.error_sq_mm2 += (level.weights.row(i).segment<3>(6 * p) / inverse(i, i) * level.force_n).squaredNorm();
    }
  }
}

Eigen::Matrix<double, StateInterpolant::kValues, 1> StateInterpolant::evaluate(const Level& level, double x,
                                                                               double y) const {
  const auto count = static_cast<int>(level.points.rows());
  Eigen::VectorXd basis(count + 3);
  for (int i = 0; i < count; ++i) {
    const double dx = level.points(i, 0) - x, dy = level.points(i, 1) - y;
    basis[i] = thin_plate(dx * dx + dy * dy);
  }
  basis.tail<3>() << 1.0, x, y;
  return level.weights.transpose() * basis;
}

TouchSample StateInterpolant::at(double x_mm, double y_mm, double force_n) const {
  // The three levels around the force, none above what was computed here: the finger may have snapped through there.
  const double limit_n = std::max(highest_force_n(x_mm, y_mm), levels_[0].force_n);
  std::size_t usable = 1;
  while (usable < levels_.size() && levels_[usable].force_n <= limit_n) ++usable;
  std::size_t first = 0;
  while (first + 3 < usable && levels_[first + 1].force_n + levels_[first + 2].force_n < 2.0 * force_n) ++first;
  const std::size_t last = std::min(first + 3, usable);

  Eigen::Matrix<double, kValues, 1> values = Eigen::Matrix<double, kValues, 1>::Zero();
  for (std::size_t k = first; k < last; ++k) {
    double share = 1.0;  // Lagrange's polynomial
    for (std::size_t m = first; m < last; ++m) {
      if (m != k) share *= (force_n - levels_[m].force_n) / (levels_[k].force_n - levels_[m].force_n);
    }
    values += share * evaluate(levels_[k], x_mm / kLength_mm, y_mm / kLength_mm);
  }
  TouchSample sample;
  sample.numbers = (force_n * values.head<kPoseDims>()).cast<float>();
  sample.displacement_mm = (force_n * values.segment<3>(kPoseDims)).cast<float>();
  sample.force_vector_n = (force_n * values.segment<3>(kPoseDims + 3)).cast<float>();
  sample.moment_nm = (force_n * values.segment<3>(kPoseDims + 6)).cast<float>();
  sample.point_mm = Eigen::Vector3d(x_mm, y_mm, values[kValues - 1]).cast<float>();
  sample.force_n = static_cast<float>(force_n);
  return sample;
}

double StateInterpolant::highest_force_n(double x_mm, double y_mm) const {
  double nearest_sq = std::numeric_limits<double>::infinity(), force_n = 0;
  for (const auto& [x, y, highest_n] : highest_) {
    const double distance_sq = (x - x_mm) * (x - x_mm) + (y - y_mm) * (y - y_mm);
    if (distance_sq >= nearest_sq) continue;
    nearest_sq = distance_sq;
    force_n = highest_n;
  }
  return force_n;
}

double StateInterpolant::leave_one_out_mm() const {
  double error_sq = 0;
  std::size_t count = 0;
  for (const Level& level : levels_) {
    error_sq += level.error_sq_mm2;
    count += static_cast<std::size_t>(level.points.rows()) * kPlates;
  }
  return std::sqrt(error_sq / static_cast<double>(count));
}

}  // namespace finsight::host
