// K^-1 is symmetric, so the response of 18 numbers to every possible force takes 18 solves: W = K^-1 A^T.
#include "hostgen/fem/linear_response.h"

#include <stdexcept>

#include "hostgen/fem/plate_errors.h"

namespace finsight::host {

namespace {

// K is factored in single precision, which leaves the softest motions wrong by up to a tenth; every refinement takes
// as much of what is left.
constexpr int kRefinements = 6;

}  // namespace

LinearResponse::LinearResponse(const PushedFinger& finger) : finger_(finger) {
  PlateErrors errors(finger.spec, finger.mesh, finger.body);
  PlatePoses at_rest;
  at_rest.seen.fill(true);
  errors.set_measured(at_rest);
  const auto size = static_cast<Eigen::Index>(finger.body.vector_size());
  Equilibrium equilibrium(finger.body);
  if (!equilibrium.linearise(finger.rest)) {
    throw std::runtime_error("the finger at rest does not resist every motion: is a part of it not attached?");
  }

  Equilibrium::Columns wanted(size, kPoseDims), W = Equilibrium::Columns::Zero(size, kPoseDims);
  Eigen::VectorXd column(size), product(size);
  const auto span = [](Eigen::VectorXd& v) { return std::span<double>(v.data(), static_cast<std::size_t>(v.size())); };
  const Numbers sigma = pose_noise(finger.spec.noise);
  for (int i = 0; i < kPoseDims; ++i) {
    errors.transpose(sigma[i] * Numbers::Unit(i), span(column));
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

  for (int axis = 0; axis < 3; ++axis) {
    PushedFinger::BodyVector weight = finger.zero();
    finger.add_weight(Eigen::Vector3d::Unit(axis), weight);
    per_g_.col(axis) = by_force_.transpose() * Eigen::Map<const Eigen::VectorXd>(weight.data(), size);
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
