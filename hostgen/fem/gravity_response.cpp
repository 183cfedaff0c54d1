#include "hostgen/fem/gravity_response.h"

#include <stdexcept>

#include "hostgen/fem/plate_errors.h"

namespace finsight::host {

Eigen::Matrix<double, kPoseDims, 3> motion_per_g(const PushedFinger& finger) {
  PlateErrors motion(finger.spec, finger.mesh, finger.body);  // away from rest, over the standard deviations
  PlatePoses at_rest;
  at_rest.seen.fill(true);
  motion.set_measured(at_rest);
  Equilibrium equilibrium(finger.body);
  if (!equilibrium.linearise(finger.rest, Equilibrium::Precision::kDouble)) {
    throw std::runtime_error("the finger at rest does not resist every motion: is a part of it not attached?");
  }
  Eigen::Matrix<double, kPoseDims, 3> per_g;
  for (int axis = 0; axis < 3; ++axis) {
    PushedFinger::BodyVector bent = finger.zero();
    finger.add_weight(Eigen::Vector3d::Unit(axis), bent);
    equilibrium.apply_inverse(bent);
    per_g.col(axis) = pose_noise(finger.spec.noise).cwiseProduct(motion.at(bent));
  }
  return per_g;
}

}  // namespace finsight::host
