// What a finger's nonlinearity adds to the linear response of its plates: a polynomial of that response, fitted to
// finite-element states of any contacts.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "hostgen/fem/dataset.h"

namespace finsight::host {

/// Rests on an observation: how far the plates of a bent finger are from where a linear one would have them depends on
/// how it is bent, hardly on what bends it. Since the linear response is exact for every load (LinearResponse), new
/// contacts, patches and combinations need no states of their own.
class ResponseSurface {
 public:
  /// Uses the valid states. Few states get few terms. Throws std::runtime_error without enough for the fewest.
  ResponseSurface(const std::vector<FemState>& states, const std::array<PoseNoise, kPlates>& noise);

  /// Motions of the plates whose linear response is `linear`.
  PoseVector poses(const PoseVector& linear) const;
  /// Displacement (mm) of the touched point, to some tenths of a millimetre: its own dimple differs from load to load.
  Vec3f displacement_mm(const PoseVector& linear) const;

 private:
  /// How many of the leading directions of the linear response enter in products of two, three and four.
  struct Terms {
    int second, third, fourth;
    std::size_t count() const;
  };
  Eigen::VectorXd directions(const PoseVector& linear) const;  ///< normalised, the strongest first
  Eigen::VectorXd products(const Eigen::VectorXd& x) const;

  Terms terms_{};
  Eigen::Matrix<double, kPoseDims, kPoseDims> to_directions_;
  Eigen::MatrixXd added_;         ///< [products, kPoseDims]
  Eigen::MatrixXd displacement_;  ///< [kPoseDims + products, 3]
};

}  // namespace finsight::host
