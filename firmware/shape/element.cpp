#include "firmware/shape/element.h"

// Legend: F deformation gradient, s its singular values, B inverse of the undeformed edges, G = F^-T, P = dPsi/dF.

namespace finsight {

template <class T>
void determinant_cubic(const T F[9], const T dF[9], T c[4]) {
  T cof_F[9], cof_dF[9];
  cofactors(F, cof_F);
  cofactors(dF, cof_dF);
  c[0] = determinant(F, cof_F);
  c[1] = inner_product(dF, cof_F);
  c[2] = inner_product(F, cof_dF);
  c[3] = determinant(dF, cof_dF);
}

template <class T>
T element_energy(const T F[9]) {
  T C[9];
  cofactors(F, C);
  const T J = determinant(F, C);
  return inner_product(F, F) + inner_product(C, C) / (J * J);
}

// Force of node a = P times the gradient of its shape function: row a - 1 of B, and minus their sum for node 0.
template <class T>
static void spread_stress(const T P[9], const T B[9], T g[12]) {
  for (int r = 0; r < 3; ++r) {
    for (int a = 0; a < 3; ++a)
      g[3 * (a + 1) + r] = P[3 * r] * B[3 * a] + P[3 * r + 1] * B[3 * a + 1] + P[3 * r + 2] * B[3 * a + 2];
    g[r] = -(g[3 + r] + g[6 + r] + g[9 + r]);
  }
}

// P = 2 (F - G G^T G), because d|F^-1|^2 = -2 F^-T F^-1 F^-T : dF.
template <class T>
void element_gradient(const T F[9], const T B[9], const T& weight, T g[12]) {
  T G[9], S[9], P[9];
  cofactors(F, G);
  const T inverse = simd::splat<T>(1) / determinant(F, G);
  for (int i = 0; i < 9; ++i) G[i] *= inverse;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c)
      S[3 * r + c] = G[3 * r] * G[3 * c] + G[3 * r + 1] * G[3 * c + 1] + G[3 * r + 2] * G[3 * c + 2];
  const T factor = simd::splat<T>(2) * weight;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c)
      P[3 * r + c] = factor * (F[3 * r + c] - S[3 * r] * G[c] - S[3 * r + 1] * G[3 + c] - S[3 * r + 2] * G[6 + c]);
  spread_stress(P, B, g);
}

template <class T>
EnergyDerivatives<T> symmetric_dirichlet(const T s[3]) {
  const T two = simd::splat<T>(2), six = simd::splat<T>(6), zero = simd::splat<T>(0);
  EnergyDerivatives<T> e;
  T inverse2[3], inverse3[3];
  e.psi = zero;
  for (int i = 0; i < 3; ++i) {
    const T inverse = simd::splat<T>(1) / s[i];
    inverse2[i] = inverse * inverse;
    inverse3[i] = inverse2[i] * inverse;
    e.psi += s[i] * s[i] + inverse2[i];
    e.first[i] = two * (s[i] - inverse3[i]);
  }
  e.second[0] = two + six * inverse2[0] * inverse2[0];
  e.second[1] = two + six * inverse2[1] * inverse2[1];
  e.second[2] = two + six * inverse2[2] * inverse2[2];
  constexpr int kPair[3][2] = {{0, 1}, {0, 2}, {1, 2}};
  for (int k = 0; k < 3; ++k) {  // (s_i^3 +- s_j^3) / (s_i +- s_j) = s_i^2 -+ s_i s_j + s_j^2
    const int i = kPair[k][0], j = kPair[k][1];
    const T q = two * inverse3[i] * inverse3[j];
    const T squares = s[i] * s[i] + s[j] * s[j], product = s[i] * s[j];
    e.flip[k] = two + q * (squares + product);
    e.twist[k] = two - q * (squares - product);
  }
  return e;
}

// Only the twist eigenvalues can be negative. The blocks off the diagonal are computed; those on it follow because a
// translation of the whole element costs nothing: every row of blocks sums to zero.
template <class T>
void element_hessian(const T F[9], const T B[9], const T& weight, T g[12], T H[90]) {
  const SingularFrame<T> frame = singular_frame(F);
  EnergyDerivatives<T> e = symmetric_dirichlet(frame.s);
  for (T& twist : e.twist) twist = simd::larger(twist, simd::splat<T>(0));
  const FrameTerms<T> terms(frame, e, weight);
  T h[4][3];
  for (int a = 1; a < 4; ++a) {
    terms.to_frame(B + 3 * (a - 1), h[a]);
    terms.gradient(h[a], g + 3 * a);
  }
  for (int i = 0; i < 3; ++i) {
    h[0][i] = -(h[1][i] + h[2][i] + h[3][i]);
    g[i] = -(g[3 + i] + g[6 + i] + g[9 + i]);
  }
  for (int k = 4; k < 10; ++k) terms.block(h[kElementBlocks[k][0]], h[kElementBlocks[k][1]], H + 9 * k);
  const T *H10 = H + 36, *H20 = H + 45, *H30 = H + 54, *H21 = H + 63, *H31 = H + 72, *H32 = H + 81;
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) {
      const int i = 3 * r + c, t = 3 * c + r;
      H[i] = -(H10[i] + H20[i] + H30[i]);
      H[9 + i] = -(H10[t] + H21[i] + H31[i]);
      H[18 + i] = -(H20[t] + H21[t] + H32[i]);
      H[27 + i] = -(H30[t] + H31[t] + H32[t]);
    }
}

#define FINSIGHT_INSTANTIATE(T)                                                  \
  template void determinant_cubic(const T[9], const T[9], T[4]);                 \
  template T element_energy(const T[9]);                                         \
  template void element_gradient(const T[9], const T[9], const T&, T[12]);       \
  template void element_hessian(const T[9], const T[9], const T&, T[12], T[90]); \
  template EnergyDerivatives<T> symmetric_dirichlet(const T[3]);
FINSIGHT_INSTANTIATE(float)
FINSIGHT_INSTANTIATE(double)
FINSIGHT_INSTANTIATE(simd::Vector<float>)
FINSIGHT_INSTANTIATE(simd::Vector<double>)
#undef FINSIGHT_INSTANTIATE

}  // namespace finsight
