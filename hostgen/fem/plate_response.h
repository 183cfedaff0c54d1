// How plates answer to small changes of the forces on a deformed finger.
#pragma once

#include <Eigen/Core>
#include <span>

#include "hostgen/fem/equilibrium.h"
#include "hostgen/fem/plate_errors.h"
#include "hostgen/fem/quadratic_mesh.h"

namespace finsight::host {

/// The tangent K of a state and W = K^-1 A^T, the derivative of the plates' errors y = A u - b by nodal forces. K is
/// factored in single precision. A finger is so soft in bending, compared with its plates, that this alone
/// leaves its softest motions wrong by a tenth; products with K in double precision put that right. Not thread-safe.
class PlateResponse {
 public:
  /// Factors with `equilibrium`; all must live as long.
  PlateResponse(const ElasticBody& body, Equilibrium& equilibrium);

  /// False if the tangent is not positive definite; what follows then means nothing. `directions`: [18, few]
  /// orthonormal; no force on the finger changes the errors in others.
  bool linearise(const ElasticState& state, const PlateErrors& errors, const Eigen::MatrixXd& directions);
  /// b -> K^-1 b for a body vector, in place, to about a thousandth.
  void solve(std::span<double> b) const;
  /// W^T f of a body vector of forces: by how much the errors change, to first order.
  Eigen::VectorXd of(std::span<const double> force_n) const;
  /// The same of one newton along the inward normal at a point of the face.
  Eigen::VectorXd of(const FacePoint& at) const;

 private:
  const ElasticBody& body_;
  Equilibrium& equilibrium_;
  Eigen::MatrixXd directions_;
  Equilibrium::Columns W_;               ///< along the directions
  Eigen::MatrixXd Z_, KZ_, compliance_;  ///< motions that span the softest ones, K times them, (Z^T K Z)^-1
};

}  // namespace finsight::host
