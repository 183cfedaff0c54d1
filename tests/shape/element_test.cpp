#include "firmware/shape/element.h"

#include <doctest/doctest.h>

#include <Eigen/Dense>

#include "hostgen/bench/second_order.h"
#include "tests/shape/frame_mesh.h"

using namespace finsight;
using test::Random;

namespace {

using Matrix9 = Eigen::Matrix<double, 9, 9>;
using Matrix12 = Eigen::Matrix<double, 12, 12>;
using Vector12 = Eigen::Matrix<double, 12, 1>;
using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

Eigen::Matrix3d random_rotation(Random& random) {
  return Eigen::Quaterniond(random.normal(), random.normal(), random.normal(), random.normal())
      .normalized()
      .toRotationMatrix();
}

struct Sample {
  Vector12 x;      // deformed points
  RowMajor3 B, F;  // inverse rest edges, deformation gradient
  double weight;
};

// A tetrahedron of random shape, stretched by factors from 0.3 to 3 along random axes; every tenth stretch is equal.
Sample random_sample(Random& random, int index) {
  Sample sample;
  Eigen::Matrix3d edges;
  do {
    edges = Eigen::Matrix3d::NullaryExpr([&] { return random.normal(); });
  } while (edges.determinant() < 0.3);
  sample.B = edges.inverse();
  Eigen::Vector3d stretch = Eigen::Vector3d::NullaryExpr([&] { return std::exp(random.uniform(-1.2, 1.1)); });
  if (index % 10 == 0) stretch.setConstant(stretch[0]);
  if (index % 10 == 5) stretch[1] = stretch[0];
  sample.F = random_rotation(random) * stretch.asDiagonal() * random_rotation(random);
  const Eigen::Vector3d origin(5, -3, 2);
  sample.x.head<3>() = origin;
  for (int a = 0; a < 3; ++a) sample.x.segment<3>(3 * a + 3) = origin + sample.F * edges.col(a);
  sample.weight = random.uniform(0.2, 3);
  return sample;
}

double energy_at(const Vector12& x, const Sample& sample) {
  double F[9];
  deformation_gradient(x.data(), sample.B.data(), F);
  return sample.weight * element_energy(F);
}

Vector12 gradient_at(const Vector12& x, const Sample& sample) {
  double F[9];
  Vector12 g;
  deformation_gradient(x.data(), sample.B.data(), F);
  element_gradient(F, sample.B.data(), sample.weight, g.data());
  return g;
}

// d vec(F) / dx, with vec row-major.
Eigen::Matrix<double, 9, 12> chain(const RowMajor3& B) {
  Eigen::Matrix<double, 9, 12> G = Eigen::Matrix<double, 9, 12>::Zero();
  for (int r = 0; r < 3; ++r)
    for (int c = 0; c < 3; ++c) {
      for (int a = 0; a < 3; ++a) G(3 * r + c, 3 * (a + 1) + r) = B(a, c);
      G(3 * r + c, r) = -B.col(c).sum();
    }
  return G;
}

// d vec(P) / d vec(F) from a function that gives dP for dF.
template <class Derivative>
Matrix9 dense_hessian(Derivative derivative) {
  Matrix9 H;
  for (int k = 0; k < 9; ++k) {
    RowMajor3 dF = RowMajor3::Zero();
    dF.data()[k] = 1;
    const RowMajor3 dP = derivative(dF);
    H.col(k) = Eigen::Map<const Eigen::Matrix<double, 9, 1>>(dP.data());
  }
  return H;
}

// Symmetric Dirichlet without singular values: P = 2 (F - G G^T G) with G = F^-T, and dG = -G dF^T G.
Matrix9 dirichlet_hessian(const RowMajor3& F) {
  const RowMajor3 G = F.inverse().transpose();
  return dense_hessian([&](const RowMajor3& dF) -> RowMajor3 {
    const RowMajor3 dG = -G * dF.transpose() * G;
    return 2 * dF - 2 * (dG * G.transpose() * G + G * dG.transpose() * G + G * G.transpose() * dG);
  });
}

Matrix9 clamped(const Matrix9& H) {
  const Eigen::SelfAdjointEigenSolver<Matrix9> solver(H);
  return solver.eigenvectors() * solver.eigenvalues().cwiseMax(0).asDiagonal() * solver.eigenvectors().transpose();
}

Matrix12 from_blocks(const double* H) {
  Matrix12 matrix;
  for (int k = 0; k < 10; ++k) {
    const Eigen::Map<const RowMajor3> block(H + 9 * k);
    matrix.block<3, 3>(3 * kElementBlocks[k][0], 3 * kElementBlocks[k][1]) = block;
    matrix.block<3, 3>(3 * kElementBlocks[k][1], 3 * kElementBlocks[k][0]) = block.transpose();
  }
  return matrix;
}

}  // namespace

TEST_CASE("element: the energy is the sum of squared singular values and their inverses") {
  Random random(1);
  for (int i = 0; i < 200; ++i) {
    const Sample sample = random_sample(random, i);
    const Eigen::Vector3d s = Eigen::JacobiSVD<Eigen::Matrix3d>(sample.F).singularValues();
    const double expected = sample.weight * (s.squaredNorm() + s.cwiseInverse().squaredNorm());
    CHECK(energy_at(sample.x, sample) == doctest::Approx(expected).epsilon(1e-12));
  }
}

TEST_CASE("element: the gradient agrees with finite differences of the energy") {
  Random random(2);
  for (int i = 0; i < 200; ++i) {
    const Sample sample = random_sample(random, i);
    const Vector12 g = gradient_at(sample.x, sample);
    Vector12 expected;
    const double h = 1e-4;  // fourth order
    for (int k = 0; k < 12; ++k) {
      const Vector12 e = h * Vector12::Unit(k);
      const double near = energy_at(sample.x + e, sample) - energy_at(sample.x - e, sample);
      const double far = energy_at(sample.x + 2 * e, sample) - energy_at(sample.x - 2 * e, sample);
      expected[k] = (8 * near - far) / (12 * h);
    }
    CHECK((g - expected).norm() <= 1e-6 * (g.norm() + energy_at(sample.x, sample)));
  }
}

TEST_CASE("element: the Hessian agrees with finite differences of the gradient where nothing is clamped") {
  Random random(3);
  int checked = 0;
  for (int i = 0; i < 1000 && checked < 100; ++i) {
    const Sample sample = random_sample(random, i);
    if (Eigen::SelfAdjointEigenSolver<Matrix9>(dirichlet_hessian(sample.F)).eigenvalues()[0] < 0) continue;
    ++checked;
    Matrix12 expected;
    const double h = 1e-4;
    for (int k = 0; k < 12; ++k) {
      const Vector12 e = h * Vector12::Unit(k);
      expected.col(k) = (8 * (gradient_at(sample.x + e, sample) - gradient_at(sample.x - e, sample)) -
                         (gradient_at(sample.x + 2 * e, sample) - gradient_at(sample.x - 2 * e, sample))) /
                        (12 * h);
    }
    double g[12], H[90];
    element_hessian(sample.F.data(), sample.B.data(), sample.weight, g, H);
    CHECK((from_blocks(H) - expected).norm() <= 1e-6 * expected.norm());
  }
  CHECK(checked == 100);
}

TEST_CASE("element: energy, gradient and Hessian agree with automatic differentiation") {
  Random random(8);
  for (int i = 0; i < 200; ++i) {
    const Sample sample = random_sample(random, i);
    const auto exact = host::dirichlet_by_differentiation(sample.x.data(), sample.B.data());
    CHECK(energy_at(sample.x, sample) == doctest::Approx(sample.weight * exact.value).epsilon(1e-12));
    const Vector12 g = gradient_at(sample.x, sample);
    CHECK((g - sample.weight * exact.gradient).norm() <= 1e-10 * (g.norm() + 1));
    // The exact Hessian of the twelve coordinates follows from that of F; the projected one from it by clamping.
    const Eigen::Matrix<double, 9, 12> G = chain(sample.B);
    const Matrix9 of_F = dirichlet_hessian(sample.F);
    CHECK((G.transpose() * of_F * G - exact.hessian).norm() <= 1e-10 * exact.hessian.norm());
    if (Eigen::SelfAdjointEigenSolver<Matrix9>(of_F).eigenvalues()[0] < 0) continue;
    double unused[12], H[90];
    element_hessian(sample.F.data(), sample.B.data(), sample.weight, unused, H);
    CHECK((from_blocks(H) - sample.weight * exact.hessian).norm() <= 1e-10 * from_blocks(H).norm());
  }
}

TEST_CASE("element: clamping the twist eigenvalues is the projection of the dense 9x9 Hessian") {
  Random random(4);
  double most_negative = 0;
  for (int i = 0; i < 500; ++i) {
    const Sample sample = random_sample(random, i);
    const Matrix9 exact = sample.weight * dirichlet_hessian(sample.F);
    most_negative = std::min(most_negative, Eigen::SelfAdjointEigenSolver<Matrix9>(exact).eigenvalues()[0]);
    const Eigen::Matrix<double, 9, 12> G = chain(sample.B);
    const Matrix12 expected = G.transpose() * clamped(exact) * G;
    double H[90];
    Vector12 g;
    element_hessian(sample.F.data(), sample.B.data(), sample.weight, g.data(), H);
    CHECK((from_blocks(H) - expected).norm() <= 1e-10 * expected.norm());
    CHECK((g - gradient_at(sample.x, sample)).norm() <= 1e-11 * (g.norm() + 1));
  }
  CHECK(most_negative < -0.1);  // otherwise nothing was clamped
}

TEST_CASE("element: every lane of a vector gives what a plain double gives, and float to its precision") {
  Random random(5);
  using Vd = simd::Vector<double>;
  using Vf = simd::Vector<float>;
  constexpr int kLanes = simd::kLanes<Vd>;
  for (int i = 0; i < 50; ++i) {
    Sample samples[kLanes];
    Vd x[12], B[9], F[9], weight, g[12], H[90];
    for (int lane = 0; lane < kLanes; ++lane) {
      samples[lane] = random_sample(random, i + lane);
      for (int k = 0; k < 12; ++k) x[k][lane] = samples[lane].x[k];
      for (int k = 0; k < 9; ++k) B[k][lane] = samples[lane].B.data()[k];
      weight[lane] = samples[lane].weight;
    }
    deformation_gradient(x, B, F);
    element_hessian(F, B, weight, g, H);
    for (int lane = 0; lane < kLanes; ++lane) {
      const Sample& sample = samples[lane];
      double scalar_g[12], scalar_H[90], lane_H[90];
      Vf float_F[9], float_B[9], float_g[12], float_H[90];
      element_hessian(sample.F.data(), sample.B.data(), sample.weight, scalar_g, scalar_H);
      for (int k = 0; k < 9; ++k) {
        float_F[k] = simd::splat<Vf>(sample.F.data()[k]);
        float_B[k] = simd::splat<Vf>(sample.B.data()[k]);
      }
      element_hessian(float_F, float_B, simd::splat<Vf>(sample.weight), float_g, float_H);
      for (int k = 0; k < 90; ++k) lane_H[k] = H[k][lane];
      const Matrix12 expected = from_blocks(scalar_H);
      CHECK((from_blocks(lane_H) - expected).norm() <= 1e-11 * expected.norm());
      for (int k = 0; k < 90; ++k) lane_H[k] = static_cast<double>(float_H[k][simd::kLanes<Vf> - 1]);
      CHECK((from_blocks(lane_H) - expected).norm() <= 1e-4 * expected.norm());
    }
  }
}

TEST_CASE("element: the cubic equals the determinant along a step") {
  Random random(6);
  for (int i = 0; i < 100; ++i) {
    const RowMajor3 F = random_sample(random, i).F;
    const RowMajor3 dF = RowMajor3::NullaryExpr([&] { return random.normal(); });
    double c[4];
    determinant_cubic(F.data(), dF.data(), c);
    for (const double t : {0.0, 0.3, 1.0, -2.0})
      CHECK(c[0] + t * (c[1] + t * (c[2] + t * c[3])) == doctest::Approx((F + t * dF).determinant()).epsilon(1e-9));
  }
}

TEST_CASE("singular frame: U diag(s) V^T is F, also for equal, tiny and reflected singular values") {
  Random random(7);
  for (int i = 0; i < 300; ++i) {
    RowMajor3 F = random_sample(random, i).F;
    if (i % 7 == 1) F.setIdentity();
    if (i % 7 == 2) F = random_rotation(random);
    if (i % 7 == 3) F.row(0) *= 1e-5;
    if (i % 7 == 4) F.col(2) *= -1;
    const SingularFrame<double> frame = singular_frame(F.data());
    const Eigen::Map<const RowMajor3> U(frame.U), V(frame.V);
    const Eigen::Map<const Eigen::Vector3d> s(frame.s);
    CHECK((U * s.asDiagonal() * V.transpose() - F).norm() <= 1e-13 * F.norm());
    CHECK((V.transpose() * V - Eigen::Matrix3d::Identity()).norm() <= 1e-13);
    CHECK(V.determinant() == doctest::Approx(1));
    Eigen::Vector3d sorted = s;
    std::sort(sorted.data(), sorted.data() + 3, std::greater<>());
    CHECK((sorted - Eigen::JacobiSVD<Eigen::Matrix3d>(F).singularValues()).norm() <= 1e-12 * F.norm());
  }
}
