// Rotations as rotation vectors (axis times angle in radians): exponential, logarithm and left Jacobian. The only
// place where either conversion is written down; hostgen uses it too.
#pragma once

#include <Eigen/Geometry>
#include <cmath>

namespace finsight {

/// The matrix K with K u = v x u.
template <class Derived>
Eigen::Matrix<typename Derived::Scalar, 3, 3> cross_matrix(const Eigen::MatrixBase<Derived>& v) {
  Eigen::Matrix<typename Derived::Scalar, 3, 3> K;
  K << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return K;
}

/// Of the rotation vector w; about x where there is nothing to rotate.
template <class Derived>
Eigen::AngleAxis<typename Derived::Scalar> so3_angle_axis(const Eigen::MatrixBase<Derived>& w) {
  using Scalar = typename Derived::Scalar;
  using Vector = Eigen::Matrix<Scalar, 3, 1>;
  const Scalar angle = w.norm();
  if (!(angle > 0)) return {0, Vector::UnitX()};
  return {angle, Vector(w / angle)};
}

/// The rotation by |w| radians about w; any finite w, the identity for zero.
template <class Derived>
Eigen::Matrix<typename Derived::Scalar, 3, 3> so3_exp(const Eigen::MatrixBase<Derived>& w) {
  return so3_angle_axis(w).toRotationMatrix();
}

/// The same as a unit quaternion, for rotations that are interpolated.
template <class Derived>
Eigen::Quaternion<typename Derived::Scalar> so3_exp_quaternion(const Eigen::MatrixBase<Derived>& w) {
  return Eigen::Quaternion<typename Derived::Scalar>(so3_angle_axis(w));
}

/// The rotation vector of R, 0 <= |w| <= pi; also near half a turn, where either of two axes may come out. R must be a
/// rotation to within rounding.
template <class Derived>
Eigen::Matrix<typename Derived::Scalar, 3, 1> so3_log(const Eigen::MatrixBase<Derived>& R) {
  using Scalar = typename Derived::Scalar;
  const Eigen::AngleAxis<Scalar> rotation{Eigen::Matrix<Scalar, 3, 3>(R)};
  return rotation.angle() * rotation.axis();
}

/// Jl with exp(w + dw) = exp(Jl dw) exp(w) to first order in dw (Barfoot, State Estimation for Robotics, 7.86).
template <class Derived>
Eigen::Matrix<typename Derived::Scalar, 3, 3> so3_left_jacobian(const Eigen::MatrixBase<Derived>& w) {
  using Scalar = typename Derived::Scalar;
  using Matrix = Eigen::Matrix<Scalar, 3, 3>;
  const Scalar angle_sq = w.squaredNorm(), angle = std::sqrt(angle_sq);
  // Below 1e-4 rad the closed forms lose their digits and the series are exact to rounding.
  const bool is_small = angle < Scalar(1e-4);
  const Scalar b = is_small ? Scalar(0.5) - angle_sq / 24 : (1 - std::cos(angle)) / angle_sq;
  const Scalar c = is_small ? Scalar(1) / 6 - angle_sq / 120 : (angle - std::sin(angle)) / (angle_sq * angle);
  const Matrix K = cross_matrix(w);
  return Matrix::Identity() + b * K + c * K * K;
}

}  // namespace finsight
