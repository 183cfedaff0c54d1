// Forward automatic differentiation to second order, dense, in a fixed number of variables: what the published solver
// uses for every element. Here it is the baseline of measurements and checks the analytic derivatives.
#pragma once

#include <Eigen/Core>

namespace finsight::host {

/// A number with its gradient and Hessian with respect to kVariables variables.
template <int kVariables>
struct SecondOrder {
  using Gradient = Eigen::Matrix<double, kVariables, 1>;
  using Hessian = Eigen::Matrix<double, kVariables, kVariables>;
  double value = 0;
  Gradient gradient = Gradient::Zero();
  Hessian hessian = Hessian::Zero();

  /// Variable number `index`, at `value`.
  static SecondOrder variable(double value, int index) {
    SecondOrder x;
    x.value = value;
    x.gradient[index] = 1;
    return x;
  }

  friend SecondOrder operator+(const SecondOrder& a, const SecondOrder& b) {
    return {a.value + b.value, a.gradient + b.gradient, a.hessian + b.hessian};
  }
  friend SecondOrder operator-(const SecondOrder& a, const SecondOrder& b) {
    return {a.value - b.value, a.gradient - b.gradient, a.hessian - b.hessian};
  }
  friend SecondOrder operator*(const SecondOrder& a, double b) { return {a.value * b, a.gradient * b, a.hessian * b}; }
  friend SecondOrder operator*(const SecondOrder& a, const SecondOrder& b) {
    return {a.value * b.value, a.gradient * b.value + b.gradient * a.value,
            a.hessian * b.value + b.hessian * a.value + a.gradient * b.gradient.transpose() +
                b.gradient * a.gradient.transpose()};
  }
  friend SecondOrder operator/(const SecondOrder& a, const SecondOrder& b) { return a * b.inverse(); }

  /// 1 / x.
  SecondOrder inverse() const {
    const double y = 1 / value;
    return {y, gradient * (-y * y), hessian * (-y * y) + gradient * gradient.transpose() * (2 * y * y * y)};
  }
};

/// Symmetric Dirichlet energy |F|^2 + |F^-1|^2 of a tetrahedron, with its derivatives with respect to the 12
/// coordinates x of its nodes. B: inverse of the undeformed edges, row-major.
inline SecondOrder<12> dirichlet_by_differentiation(const double x[12], const double B[9]) {
  using Number = SecondOrder<12>;
  Number edges[9], F[9];
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c)
      edges[3 * r + c] = Number::variable(x[3 * (c + 1) + r], 3 * (c + 1) + r) - Number::variable(x[r], r);
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c)
      F[3 * r + c] = edges[3 * r] * B[c] + edges[3 * r + 1] * B[3 + c] + edges[3 * r + 2] * B[6 + c];
  const auto minor = [&](int r, int c) {
    const int r1 = (r + 1) % 3, r2 = (r + 2) % 3, c1 = (c + 1) % 3, c2 = (c + 2) % 3;
    return F[3 * r1 + c1] * F[3 * r2 + c2] - F[3 * r1 + c2] * F[3 * r2 + c1];
  };
  const Number det = F[0] * minor(0, 0) + F[1] * minor(0, 1) + F[2] * minor(0, 2);
  Number sum, minors;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) {
      const Number m = minor(r, c);
      sum = sum + F[3 * r + c] * F[3 * r + c];
      minors = minors + m * m;
    }
  return sum + minors / (det * det);
}

}  // namespace finsight::host
