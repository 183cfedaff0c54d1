#include "hostgen/fem/neo_hookean.h"

#include <doctest/doctest.h>

#include <Eigen/Dense>
#include <cmath>
#include <cstdint>
#include <cstdlib>

#include "firmware/shape/simd.h"

using Eigen::Matrix3d;
using finsight::host::neo_hookean;
using finsight::host::NeoHookean;
using finsight::host::NeoHookeanState;

namespace {

/// The material's definition, word for word.
double energy(const Matrix3d& F, const NeoHookean& material) {
  const double J = F.determinant();
  return 0.5 * material.mu_mpa * (std::pow(J, -2.0 / 3) * F.squaredNorm() - 3) +
         0.5 * material.bulk_mpa * (J - 1) * (J - 1);
}

NeoHookeanState<double> state_of(const Matrix3d& F, const NeoHookean& material) {
  NeoHookeanState<double> state;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) state.F[i][j] = F(i, j);
  }
  state.mu = material.mu_mpa;
  state.bulk = material.bulk_mpa;
  state.evaluate();
  return state;
}

Matrix3d inverse_of(const NeoHookeanState<double>& state) {
  Matrix3d inverse;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) inverse(i, j) = state.inverse[i][j];
  }
  return inverse;
}

Matrix3d first_stress(const Matrix3d& F, const NeoHookean& material) {
  const auto state = state_of(F, material);
  return state.c * F + state.b * inverse_of(state).transpose();
}

Matrix3d second_stress(const Matrix3d& F, const Matrix3d& change, const NeoHookean& material) {
  double D[3][3], S[6];
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) D[i][j] = change(i, j);
  }
  state_of(F, material).stress(D, S);
  Matrix3d stress;
  stress << S[0], S[1], S[2], S[1], S[3], S[4], S[2], S[4], S[5];
  return stress;
}

/// Second derivative of the energy along D, by the formula in the header.
double curvature(const Matrix3d& F, const Matrix3d& D, const NeoHookean& material) {
  const auto state = state_of(F, material);
  const Matrix3d A = D * inverse_of(state);
  const double t = A.trace();
  return second_stress(F, Matrix3d::Zero(), material).cwiseProduct(D.transpose() * D).sum() + state.v() * t * t -
         4.0 / 3 * state.c * t * F.cwiseProduct(D).sum() - 2 * state.b * (0.5 * (A + A.transpose())).squaredNorm();
}

/// Strong but possible deformations: volume ratios from about 0.4 to 2.5.
Matrix3d random_deformation(std::uint32_t seed) {
  std::srand(seed);
  Matrix3d F;
  do {
    F = Matrix3d::Identity() + 0.45 * Matrix3d::Random();
  } while (F.determinant() < 0.4);
  return F;
}

const NeoHookean kMaterial = neo_hookean(10, 0.47);

}  // namespace

TEST_CASE("neo_hookean: the stress is the energy's derivative") {
  for (std::uint32_t seed = 1; seed <= 50; ++seed) {
    const Matrix3d F = random_deformation(seed), P = first_stress(F, kMaterial);
    for (int i = 0; i < 9; ++i) {
      Matrix3d D = Matrix3d::Zero();
      D(i / 3, i % 3) = 1e-5;
      const double difference = (energy(F + D, kMaterial) - energy(F - D, kMaterial)) / 2e-5;
      CHECK(P(i / 3, i % 3) == doctest::Approx(difference).epsilon(1e-6).scale(10));
    }
  }
}

TEST_CASE("neo_hookean: the second derivative is the stress's derivative") {
  for (std::uint32_t seed = 1; seed <= 50; ++seed) {
    const Matrix3d F = random_deformation(seed), D = Matrix3d::Random();
    const double h = 1e-5;
    const double difference =
        (first_stress(F + h * D, kMaterial) - first_stress(F - h * D, kMaterial)).cwiseProduct(D).sum() / (2 * h);
    CHECK(curvature(F, D, kMaterial) == doctest::Approx(difference).epsilon(1e-6).scale(10));
  }
}

TEST_CASE("neo_hookean: both forms of the stress agree, and a step's change of stress is right to first order") {
  for (std::uint32_t seed = 1; seed <= 50; ++seed) {
    const Matrix3d F = random_deformation(seed), D = Matrix3d::Random(), none = Matrix3d::Zero();
    CHECK((F * second_stress(F, none, kMaterial) - first_stress(F, kMaterial)).norm() < 1e-11);
    const double h = 1e-5;
    const Matrix3d difference =
        (second_stress(F + h * D, none, kMaterial) - second_stress(F - h * D, none, kMaterial)) / (2 * h);
    const Matrix3d change = second_stress(F, D, kMaterial) - second_stress(F, none, kMaterial);
    CHECK((change - difference).norm() < 1e-6 * (1 + difference.norm()));
  }
}

TEST_CASE("neo_hookean: rest and rotations are stress-free, small strains obey Hooke") {
  const Matrix3d R = Eigen::AngleAxisd(2.1, Eigen::Vector3d(1, 2, -3).normalized()).toRotationMatrix();
  CHECK(first_stress(Matrix3d::Identity(), kMaterial).norm() < 1e-14);
  CHECK(first_stress(R, kMaterial).norm() < 1e-12);
  Matrix3d strain;
  strain << 3, 1, -2, 1, -1, 0.5, -2, 0.5, 2;
  strain *= 1e-7;
  const double lambda = kMaterial.bulk_mpa - 2.0 / 3 * kMaterial.mu_mpa;
  const Matrix3d hooke = 2 * kMaterial.mu_mpa * strain + lambda * strain.trace() * Matrix3d::Identity();
  CHECK((first_stress(Matrix3d::Identity() + strain, kMaterial) - hooke).norm() < 1e-5 * hooke.norm());
  // Young's modulus and Poisson's ratio come back from the moduli.
  CHECK(9 * kMaterial.bulk_mpa * kMaterial.mu_mpa / (3 * kMaterial.bulk_mpa + kMaterial.mu_mpa) == doctest::Approx(10));
  CHECK(lambda / (2 * (lambda + kMaterial.mu_mpa)) == doctest::Approx(0.47));
}

TEST_CASE("neo_hookean: vectorised and scalar results are equal, lane by lane") {
  using Pack = finsight::simd::Vector<double>;
  NeoHookeanState<Pack> all;
  for (int lane = 0; lane < finsight::simd::kLanes<Pack>; ++lane) {
    const Matrix3d F = random_deformation(static_cast<std::uint32_t>(lane + 7));
    for (int i = 0; i < 9; ++i) all.F[i / 3][i % 3][lane] = F(i / 3, i % 3);
    all.mu[lane] = kMaterial.mu_mpa;
    all.bulk[lane] = kMaterial.bulk_mpa;
  }
  all.evaluate();
  for (int lane = 0; lane < finsight::simd::kLanes<Pack>; ++lane) {
    const auto one = state_of(random_deformation(static_cast<std::uint32_t>(lane + 7)), kMaterial);
    CHECK(double{all.J[lane]} == doctest::Approx(one.J).epsilon(1e-14));
    CHECK(double{all.b[lane]} == doctest::Approx(one.b).epsilon(1e-12));
    CHECK(double{all.c[lane]} == doctest::Approx(one.c).epsilon(1e-14));
  }
}
