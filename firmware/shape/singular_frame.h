// Isotropic energies of a deformation gradient, by its singular values: F = U diag(s) V^T, Psi(F) = psi(s0) + psi(s1) +
// psi(s2). What an energy must deliver is EnergyDerivatives; this header turns them into forces and Hessian blocks of
// nodes (Smith, De Goes, Kim, "Analytic eigensystems for isotropic distortion energies", 2019). T is float, double or a
// vector of them (simd.h). Matrices are row-major 3x3 arrays of 9; symmetric ones are arrays of 6: 00 01 02 11 12 22.
#pragma once

#include "firmware/shape/simd.h"

namespace finsight {

/// F = U diag(s) V^T; V is a rotation. s > 0 unless F is singular; if det F < 0, U is a reflection (the caller must
/// look at the determinant: psi(s) does not know of it).
template <class T>
struct SingularFrame {
  T U[9], V[9], s[3];
};

/// The energy and its derivatives at s. The eigenvalues of the Hessian d2Psi/dF2 are `second` (psi'') and, for each
/// pair of singular values (0,1), (0,2), (1,2): twist = (psi_i + psi_j) / (s_i + s_j), flip = (psi_i - psi_j) / (s_i -
/// s_j), which an energy gives in a form that does not divide by s_i - s_j.
template <class T>
struct EnergyDerivatives {
  T psi;
  T first[3];
  T second[3];
  T twist[3];
  T flip[3];
};

/// Eigen-decomposition of a symmetric matrix by a fixed number of cyclic Jacobi sweeps, no branches: on return
/// a = diag(a[0], a[3], a[5]) up to rounding, and the columns of Q are the eigenvectors (in no order).
template <class T>
inline void symmetric_eigen(T a[6], T Q[9]) {
  using S = simd::Scalar<T>;
  // The sweeps converge quadratically, from the third on: 3 reach the rounding of float, 4 that of double.
  constexpr int kSweeps = sizeof(S) == 8 ? 4 : 3;
  const T zero = simd::splat<T>(0), one = simd::splat<T>(1), tiny = simd::splat<T>(sizeof(S) == 8 ? 1e-290 : 1e-35);
  for (int i = 0; i < 9; ++i) Q[i] = i % 4 == 0 ? one : zero;
  const auto rotate = [&](T& app, T& aqq, T& apq, T& arp, T& arq, int p, int q) {
    const T difference = aqq - app;
    const T root = simd::square_root(T(difference * difference + simd::splat<T>(4) * apq * apq));
    const T denominator = difference < zero ? difference - root - tiny : difference + root + tiny;
    const T t = simd::splat<T>(2) * apq / denominator;  // tangent of the smaller rotation; 0 for a diagonal matrix
    const T c = one / simd::square_root(T(one + t * t));
    const T s = t * c;
    app -= t * apq;
    aqq += t * apq;
    apq = zero;
    const T rp = c * arp - s * arq, rq = s * arp + c * arq;
    arp = rp;
    arq = rq;
    for (int r = 0; r < 3; ++r) {
      const T u = Q[3 * r + p], w = Q[3 * r + q];
      Q[3 * r + p] = c * u - s * w;
      Q[3 * r + q] = s * u + c * w;
    }
  };
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    rotate(a[0], a[3], a[1], a[2], a[4], 0, 1);
    rotate(a[0], a[5], a[2], a[1], a[4], 0, 2);
    rotate(a[3], a[5], a[4], a[1], a[2], 1, 2);
  }
}

/// The singular frame of F. V comes from F^T F, s and U from F V: so a small singular value keeps its digits.
template <class T>
inline SingularFrame<T> singular_frame(const T F[9]) {
  T C[6];
  for (int i = 0, k = 0; i < 3; ++i)
    for (int j = i; j < 3; ++j, ++k) C[k] = F[i] * F[j] + F[3 + i] * F[3 + j] + F[6 + i] * F[6 + j];
  SingularFrame<T> frame;
  symmetric_eigen(C, frame.V);
  const T* V = frame.V;
  for (int c = 0; c < 3; ++c) {
    T y[3];
    for (int r = 0; r < 3; ++r) y[r] = F[3 * r] * V[c] + F[3 * r + 1] * V[3 + c] + F[3 * r + 2] * V[6 + c];
    frame.s[c] = simd::square_root(T(y[0] * y[0] + y[1] * y[1] + y[2] * y[2]));
    const T inverse = simd::splat<T>(1) / frame.s[c];
    for (int r = 0; r < 3; ++r) frame.U[3 * r + c] = y[r] * inverse;
  }
  return frame;
}

/// Forces and Hessian blocks of the nodes of one element or quadrature point. For every node a, let g_a be the gradient
/// of its shape function in the undeformed body (F = sum x_a g_a^T) and h_a = V^T g_a (to_frame).
template <class T>
class FrameTerms {
 public:
  /// All results are multiplied by `weight` (the volume that this point stands for).
  FrameTerms(const SingularFrame<T>& frame, const EnergyDerivatives<T>& e, const T& weight) : frame_(frame) {
    const T half = simd::splat<T>(0.5) * weight;
    for (int k = 0; k < 3; ++k) {
      first_[k] = weight * e.first[k];
      second_[k] = weight * e.second[k];
      same_[k] = half * (e.flip[k] + e.twist[k]);
      cross_[k] = half * (e.flip[k] - e.twist[k]);
    }
  }

  /// h = V^T g.
  void to_frame(const T g[3], T h[3]) const {
    const T* V = frame_.V;
    for (int i = 0; i < 3; ++i) h[i] = V[i] * g[0] + V[3 + i] * g[1] + V[6 + i] * g[2];
  }

  /// dPsi/dx_a, from h_a.
  void gradient(const T h[3], T out[3]) const {
    const T* U = frame_.U;
    const T q[3] = {first_[0] * h[0], first_[1] * h[1], first_[2] * h[2]};
    for (int r = 0; r < 3; ++r) out[r] = U[3 * r] * q[0] + U[3 * r + 1] * q[1] + U[3 * r + 2] * q[2];
  }

  /// d2Psi/dx_b dx_a as a 3x3 block (rows: b), from h_b and h_a.
  void block(const T hb[3], const T ha[3], T out[9]) const {
    T K[9];  // the block in the frame's coordinates: U^T H U
    const T q0 = hb[0] * ha[0], q1 = hb[1] * ha[1], q2 = hb[2] * ha[2];
    K[0] = second_[0] * q0 + same_[0] * q1 + same_[1] * q2;
    K[4] = second_[1] * q1 + same_[0] * q0 + same_[2] * q2;
    K[8] = second_[2] * q2 + same_[1] * q0 + same_[2] * q1;
    constexpr int kPair[3][2] = {{0, 1}, {0, 2}, {1, 2}};
    for (int k = 0; k < 3; ++k) {
      const int i = kPair[k][0], j = kPair[k][1];
      const T ij = hb[i] * ha[j], ji = hb[j] * ha[i];
      K[3 * i + j] = cross_[k] * ji;
      K[3 * j + i] = cross_[k] * ij;
    }
    const T* U = frame_.U;
    T UK[9];
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c) UK[3 * r + c] = U[3 * r] * K[c] + U[3 * r + 1] * K[3 + c] + U[3 * r + 2] * K[6 + c];
    for (int r = 0; r < 3; ++r)
      for (int c = 0; c < 3; ++c)
        out[3 * r + c] = UK[3 * r] * U[3 * c] + UK[3 * r + 1] * U[3 * c + 1] + UK[3 * r + 2] * U[3 * c + 2];
  }

 private:
  const SingularFrame<T>& frame_;
  T first_[3], second_[3], same_[3], cross_[3];
};

}  // namespace finsight
