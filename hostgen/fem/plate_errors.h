// How far a deformed finger's plates are from where they were measured, as a linear function of its displacements.
#pragma once

#include <array>
#include <span>

#include "hostgen/fem/elastic_body.h"
#include "hostgen/finger/mesh.h"

namespace finsight::host {

/// The 18 numbers y = A u - b: per plate (top, middle, low) its displacement x y z and small rotation x y z away from
/// the measured pose, each over the standard deviation that the spec gives it. A plate is the rigid fit to its nodes;
/// the fit is made about the measured pose, which is why A is constant for one measurement.
class PlateErrors {
 public:
  /// `mesh` and `body` must outlive this object. Standard deviations below 1e-6 (mm, rad) count as that.
  PlateErrors(const FingerSpec& spec, const QuadraticMesh& mesh, const ElasticBody& body);

  /// Plates that are not seen get no weight: their errors are 0.
  void set_measured(const PlatePoses& measured);
  /// y at displacements `u`, a vector of the body.
  PoseVectorOf<double> at(std::span<const double> u) const;
  /// A^T y, a vector of the body.
  void transpose(const PoseVectorOf<double>& y, std::span<double> w) const;

 private:
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  struct Fit {
    std::vector<std::size_t> place;  ///< of the plate's nodes in a vector of the body
    Eigen::Matrix3Xd rest;           ///< of the nodes
    Eigen::Matrix3Xd target, arm;  ///< where they would be if the plate were as measured, from the marker's centre too
    Eigen::Vector3d centre;        ///< of the marker at rest
    Eigen::Matrix<double, 6, 1> sigma;
    Matrix6 weight = Matrix6::Zero();  ///< sums over nodes -> errors over standard deviations
  };
  std::array<Fit, kPlates> fits_;
};

}  // namespace finsight::host
