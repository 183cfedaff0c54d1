// Symmetric Dirichlet energy of linear tetrahedra, Psi(F) = |F|^2 + |F^-1|^2 (Smith and Schaefer, "Bijective
// parameterization with free boundaries", 2015), with gradient and positive semidefinite Hessian. T is float, double or
// a vector of them: then every lane is a tetrahedron. Nothing here branches.
#pragma once

#include "firmware/shape/singular_frame.h"

namespace finsight {

/// Order of the ten 3x3 blocks (row node, column node) of an element's Hessian, each row-major.
inline constexpr int kElementBlocks[10][2] = {{0, 0}, {1, 1}, {2, 2}, {3, 3}, {1, 0},
                                              {2, 0}, {3, 0}, {2, 1}, {3, 1}, {3, 2}};

/// F = [x1 - x0, x2 - x0, x3 - x0] B. x: four points of three numbers; B: inverse of the matrix of undeformed edges
/// [X1 - X0, X2 - X0, X3 - X0], row-major. Applied to displacements it gives the change of F.
template <class T>
inline void deformation_gradient(const T x[12], const T B[9], T F[9]) {
  for (int r = 0; r < 3; ++r) {
    const T e[3] = {x[3 + r] - x[r], x[6 + r] - x[r], x[9 + r] - x[r]};
    for (int c = 0; c < 3; ++c) F[3 * r + c] = e[0] * B[c] + e[1] * B[3 + c] + e[2] * B[6 + c];
  }
}

/// Cofactor matrix: F^-T times det F.
template <class T>
inline void cofactors(const T F[9], T C[9]) {
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) {
      const int r1 = (r + 1) % 3, r2 = (r + 2) % 3, c1 = (c + 1) % 3, c2 = (c + 2) % 3;
      C[3 * r + c] = F[3 * r1 + c1] * F[3 * r2 + c2] - F[3 * r1 + c2] * F[3 * r2 + c1];
    }
}

template <class T>
inline T inner_product(const T A[9], const T B[9]) {
  T sum = A[0] * B[0];
  for (int i = 1; i < 9; ++i) sum += A[i] * B[i];
  return sum;
}

/// det F from F and its cofactors.
template <class T>
inline T determinant(const T F[9], const T cofactor[9]) {
  return F[0] * cofactor[0] + F[1] * cofactor[1] + F[2] * cofactor[2];
}

/// det(F + t dF) = c[0] + c[1] t + c[2] t^2 + c[3] t^3.
template <class T>
void determinant_cubic(const T F[9], const T dF[9], T c[4]);

/// Psi, meaningful for det F > 0 only.
template <class T>
T element_energy(const T F[9]);

/// Gradient g[12] of weight * Psi with respect to x. Needs no singular frame.
template <class T>
void element_gradient(const T F[9], const T B[9], const T& weight, T g[12]);

/// The same gradient, and the ten blocks H[90] of the Hessian of weight * Psi, its negative eigenvalues clamped to
/// zero.
template <class T>
void element_hessian(const T F[9], const T B[9], const T& weight, T g[12], T H[90]);

/// Symmetric Dirichlet by singular values: the sum over i of s_i^2 + s_i^-2; Hessian not clamped.
template <class T>
EnergyDerivatives<T> symmetric_dirichlet(const T s[3]);

}  // namespace finsight
