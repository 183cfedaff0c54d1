#include "firmware/geometry/so3.h"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <numbers>
#include <vector>

namespace {

using namespace finsight;
using Eigen::Matrix3d;
using Eigen::Vector3d;

/// Vectors of every size that occurs: rest, below and above the series' limit, ordinary ones, nearly half a turn.
std::vector<Vector3d> vectors() {
  std::vector<Vector3d> all = {Vector3d::Zero()};
  for (const double angle : {1e-9, 9e-5, 1.1e-4, 0.01, 0.5, 2.0, std::numbers::pi - 1e-6}) {
    for (const Vector3d& axis : {Vector3d(1, 0, 0), Vector3d(0, -1, 0), Vector3d(1, 2, -3)}) {
      all.push_back(angle * axis.normalized());
    }
  }
  return all;
}

/// exp as its power series, slowly.
Matrix3d exp_by_series(const Vector3d& w) {
  Matrix3d term = Matrix3d::Identity(), sum = term;
  for (int n = 1; n < 60; ++n) sum += term = (term * cross_matrix(w) / n).eval();
  return sum;
}

}  // namespace

TEST_CASE("so3: the cross matrix multiplies as the cross product") {
  const Vector3d v(1, -2, 3), u(0.5, 0.25, -4);
  CHECK((cross_matrix(v) * u - v.cross(u)).norm() == doctest::Approx(0).epsilon(1e-15));
}

TEST_CASE("so3: the exponential is its power series") {
  for (const Vector3d& w : vectors()) CHECK((so3_exp(w) - exp_by_series(w)).norm() < 1e-13);
}

TEST_CASE("so3: the quaternion is the same rotation") {
  for (const Vector3d& w : vectors()) {
    CHECK((so3_exp_quaternion(w).toRotationMatrix() - so3_exp(w)).norm() < 1e-14);
    CHECK(std::abs(so3_exp_quaternion(w).norm() - 1) < 1e-15);
  }
  CHECK(so3_exp(Vector3d(Vector3d::Zero())) == Matrix3d::Identity());
}

TEST_CASE("so3: the logarithm undoes the exponential up to half a turn") {
  for (const Vector3d& w : vectors()) CHECK((so3_log(so3_exp(w)) - w).norm() < 1e-9);
  const Matrix3d half_turn = so3_exp(Vector3d(0, std::numbers::pi, 0));
  CHECK((so3_exp(so3_log(half_turn)) - half_turn).norm() < 1e-12);
}

TEST_CASE("so3: the left Jacobian is that of finite differences") {
  constexpr double kStep = 1e-6;
  for (const Vector3d& w : vectors()) {
    for (int axis = 0; axis < 3; ++axis) {
      const Vector3d dw = kStep * Vector3d::Unit(axis);
      const Vector3d moved = so3_log(so3_exp(Vector3d(w + dw)) * so3_exp(Vector3d(w - dw)).transpose()) / (2 * kStep);
      CHECK((so3_left_jacobian(w).col(axis) - moved).norm() < 1e-8);
    }
  }
}

TEST_CASE("so3: floats are rotated like doubles") {
  const Eigen::Vector3f w(0.3F, -0.2F, 0.9F);
  CHECK((so3_exp(w).cast<double>() - so3_exp(Vector3d(w.cast<double>()))).norm() < 1e-6);
  CHECK((so3_log(so3_exp(w)) - w).norm() < 1e-6F);
}
