// K^-1 is symmetric, so the response of 18 numbers to every possible force takes 18 solves: W = K^-1 A^T.
#include "hostgen/fem/linear_response.h"

#include "hostgen/fem/plate_errors.h"

namespace finsight::host {

namespace {

// K is factored in single precision, which leaves the softest motions wrong by up to a tenth; every refinement takes
// as much of what is left.
constexpr int kRefinements = 6;

/// Weights of a tet's ten nodes in the integral of a constant over it (corners -1/20, middles 1/5: exact for C3D10).
constexpr double kCornerWeight = -0.05, kMiddleWeight = 0.2;

}  // namespace

LinearResponse::LinearResponse(const PushedFinger& finger) : finger_(finger) {
  PlateErrors errors(finger.spec, finger.mesh, finger.body);
  PlatePoses at_rest;
  at_rest.seen.fill(true);
  errors.set_measured(at_rest);
  const auto size = static_cast<Eigen::Index>(finger.body.vector_size());
  Equilibrium equilibrium(finger.body);
  equilibrium.linearise(finger.rest);

  Equilibrium::Columns wanted(size, kPoseDims), W = Equilibrium::Columns::Zero(size, kPoseDims);
  Eigen::VectorXd column(size), product(size);
  const auto span = [](Eigen::VectorXd& v) { return std::span<double>(v.data(), static_cast<std::size_t>(v.size())); };
  for (int i = 0; i < kPoseDims; ++i) {
    const double sigma = std::max(
        finger.spec.noise[static_cast<std::size_t>(i / 6)].standard_deviations()[static_cast<std::size_t>(i % 6)],
        PoseNoise::kMin);
    errors.transpose(sigma * Numbers::Unit(i), span(column));
    wanted.col(i) = column;
  }
  Equilibrium::Columns missing = wanted;
  for (int k = 0; k < kRefinements; ++k) {
    equilibrium.apply_inverse(missing);
    W += missing;
    for (int i = 0; i < kPoseDims; ++i) {
      column = W.col(i);
      finger.body.times_tangent(finger.rest.u, finger.rest.stress, span(column), span(product));
      missing.col(i) = wanted.col(i) - product;
    }
    missing.bottomRows<3>().setZero();
  }
  by_force_ = W;

  constexpr double kGravity_m_s2 = 9.80665, kM3PerMm3 = 1e-9;
  per_g_.setZero();
  for (const auto& tet : finger.mesh.tets) {
    std::array<Eigen::Vector3d, 4> corner;
    for (std::size_t i = 0; i < 4; ++i) corner[i] = finger.mesh.node_mm[static_cast<std::size_t>(tet[i])];
    const double mass_kg =
        finger.spec.density_kg_m3 * kM3PerMm3 * tet_gradients(corner, finger.mesh.element).volume_mm3;
    mass_kg_ += mass_kg;
    for (std::size_t i = 0; i < kTetNodes; ++i) {
      const Eigen::Index row = 3 * finger.body.unknown_of_node()[static_cast<std::size_t>(tet[i])];
      const double weight_n = kGravity_m_s2 * mass_kg * (i < 4 ? kCornerWeight : kMiddleWeight);
      for (Eigen::Index d = 0; d < 3; ++d) per_g_.col(d) += weight_n * by_force_.row(row + d).transpose();
    }
  }
}

LinearResponse::Numbers LinearResponse::of(const FacePoint& at, const Eigen::Vector3d& force_n) const {
  Numbers sum = Numbers::Zero();
  for (std::size_t i = 0; i < at.node.size(); ++i) {
    const Eigen::Index row = 3 * finger_.body.unknown_of_node()[static_cast<std::size_t>(at.node[i])];
    sum.noalias() += by_force_.middleRows<3>(row).transpose() * (at.weight[i] * force_n);
  }
  return sum;
}

}  // namespace finsight::host
