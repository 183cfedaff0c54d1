// The compressible neo-Hookean material in the form of Abaqus and CalculiX, per undeformed volume:
//   W(F) = mu/2 (J^(-2/3) I1 - 3) + K/2 (J - 1)^2,   J = det F,  I1 = |F|^2.
// Its derivatives need no eigenvectors: they are a few outer products. For a change D of F let A = D F^-1, t = tr A:
//   dW  = P : D                    P = F S = c F + b F^-T   (first Piola-Kirchhoff stress)
//   d2W = S : D^T D                                         (the part that the stress makes: "geometric")
//         + v t^2 - 4/3 c t (F : D) - 2 b |sym A|^2         (the part that the material makes)
//   c = mu J^(-2/3),  b = K (J - 1) J - c I1 / 3,  v = 2/9 c I1 + K (2 J - 1) J,
//   S = c 1 + b (F^T F)^-1         (second Piola-Kirchhoff stress)
#pragma once

#include <bit>
#include <cstdint>

#include "firmware/shape/simd.h"

namespace finsight::host {

/// Shear and bulk modulus at rest, MPa = N/mm^2.
struct NeoHookean {
  double mu_mpa = 0, bulk_mpa = 0;
};
/// From Young's modulus and Poisson's ratio of small deformations.
inline NeoHookean neo_hookean(double youngs_modulus_mpa, double poisson_ratio) {
  return {youngs_modulus_mpa / (2 * (1 + poisson_ratio)), youngs_modulus_mpa / (3 * (1 - 2 * poisson_ratio))};
}

/// x^(-1/3) of a positive number, to the last digit or two, without leaving the vector. Newton's method for
/// 1 / y^3 = x; its start, from the bits of x (a third of its exponent), is right to 4 %.
template <class Number>
inline Number inverse_cube_root(const Number& x) {
  Number y = simd::map_lanes(x, [](double lane) {
    constexpr std::uint64_t kMagic = 0x553EF0FF289DD796;
    return std::bit_cast<double>(kMagic - std::bit_cast<std::uint64_t>(lane) / 3);
  });
  for (int i = 0; i < 4; ++i) y *= (4.0 - x * y * y * y) * (1.0 / 3);
  return y;
}

/// Everything about one deformation gradient. Number is double or a vector of doubles (simd.h), a deformation per lane.
template <class Number>
struct NeoHookeanState {
  Number F[3][3], inverse[3][3];
  Number J, I1;
  Number mu, bulk;
  Number c, b;  ///< the letters of the formulas above

  /// F, mu and bulk are set; J must be positive for the derivatives to mean anything.
  void evaluate() {
    for (int i = 0; i < 3; ++i) {
      const int j = (i + 1) % 3, k = (i + 2) % 3;
      for (int l = 0; l < 3; ++l) {
        const int m = (l + 1) % 3, n = (l + 2) % 3;
        inverse[l][i] = F[j][m] * F[k][n] - F[j][n] * F[k][m];  // cofactors; divided by J below
      }
    }
    J = F[0][0] * inverse[0][0] + F[0][1] * inverse[1][0] + F[0][2] * inverse[2][0];
    const Number one_over_J = 1.0 / J;
    I1 = J - J;
    for (int i = 0; i < 3; ++i) {
      for (int l = 0; l < 3; ++l) {
        inverse[i][l] *= one_over_J;
        I1 += F[i][l] * F[i][l];
      }
    }
    const Number root = inverse_cube_root(J);
    c = mu * root * root;
    b = bulk * (J - 1.0) * J - c * I1 * (1.0 / 3);
  }
  Number v() const { return (2.0 / 9) * c * I1 + bulk * (2.0 * J - 1.0) * J; }
  /// S + dS for a change D of F, to first order: 00 01 02 11 12 22.
  void stress(const Number (&D)[3][3], Number (&S)[6]) const;
};

template <class Number>
void NeoHookeanState<Number>::stress(const Number (&D)[3][3], Number (&S)[6]) const {
  // B = F^-1 D and C^-1 = (F^T F)^-1 = F^-1 F^-T, whose change is -(B C^-1 + C^-1 B^T).
  Number B[3][3], C_inverse[3][3], F_D = J - J;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      B[i][j] = inverse[i][0] * D[0][j] + inverse[i][1] * D[1][j] + inverse[i][2] * D[2][j];
      C_inverse[i][j] = inverse[i][0] * inverse[j][0] + inverse[i][1] * inverse[j][1] + inverse[i][2] * inverse[j][2];
      F_D += F[i][j] * D[i][j];
    }
  }
  const Number t = B[0][0] + B[1][1] + B[2][2], dc = (-2.0 / 3) * c * t;
  const Number db = bulk * (2.0 * J - 1.0) * J * t - (dc * I1 + 2.0 * c * F_D) * (1.0 / 3);
  for (int i = 0, k = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j, ++k) {
      S[k] = (b + db) * C_inverse[i][j];
      for (int m = 0; m < 3; ++m) S[k] -= b * (B[i][m] * C_inverse[m][j] + B[j][m] * C_inverse[m][i]);
      if (i == j) S[k] += c + dc;
    }
  }
}

}  // namespace finsight::host
