#include "hostgen/fem/plate_errors.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>

#include "firmware/geometry/so3.h"

namespace finsight::host {

namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;

/// How a point at `arm` from the centre moves by a small displacement and rotation.
Eigen::Matrix<double, 3, 6> rigid_motion(const Eigen::Vector3d& arm) {
  Eigen::Matrix<double, 3, 6> motion;
  motion.leftCols<3>().setIdentity();
  motion.rightCols<3>() = -cross_matrix(arm);
  return motion;
}

}  // namespace

PlateErrors::PlateErrors(const FingerSpec& spec, const QuadraticMesh& mesh, const ElasticBody& body) {
  for (std::size_t p = 0; p < kPlates; ++p) {
    Fit& fit = fits_[p];
    fit.centre = spec.plates[p].T_finger_marker.translation();
    fit.rest.resize(3, static_cast<Eigen::Index>(mesh.plate_nodes[p].size()));
    for (const int node : mesh.plate_nodes[p]) {
      const auto index = static_cast<std::size_t>(node);
      fit.rest.col(static_cast<Eigen::Index>(fit.place.size())) = mesh.node_mm[index];
      fit.place.push_back(3 * static_cast<std::size_t>(body.unknown_of_node()[index]));
    }
    fit.sigma = pose_noise(spec.noise).segment<6>(static_cast<Eigen::Index>(6 * p));
  }
}

void PlateErrors::set_measured(const PlatePoses& measured) {
  for (std::size_t p = 0; p < kPlates; ++p) {
    Fit& fit = fits_[p];
    const Eigen::Matrix3d R = so3_exp(measured.plates[p].rotation_rad.cast<double>());
    fit.arm = R * (fit.rest.colwise() - fit.centre);
    fit.target = fit.arm.colwise() + (fit.centre + measured.plates[p].displacement_mm.cast<double>());
    fit.weight.setZero();
    if (!measured.seen[p]) continue;
    Matrix6 normal = Matrix6::Zero();
    for (Eigen::Index i = 0; i < fit.arm.cols(); ++i) {
      const Eigen::Matrix<double, 3, 6> motion = rigid_motion(fit.arm.col(i));
      normal += motion.transpose() * motion;
    }
    fit.weight = fit.sigma.cwiseInverse().asDiagonal() * Matrix6(normal.ldlt().solve(Matrix6::Identity()));
  }
}

PoseVectorOf<double> PlateErrors::at(std::span<const double> u) const {
  PoseVectorOf<double> y;
  for (std::size_t p = 0; p < kPlates; ++p) {
    const Fit& fit = fits_[p];
    Vector6 sums = Vector6::Zero();
    for (std::size_t i = 0; i < fit.place.size(); ++i) {
      const auto column = static_cast<Eigen::Index>(i);
      const Eigen::Vector3d error =
          fit.rest.col(column) + Eigen::Map<const Eigen::Vector3d>(&u[fit.place[i]]) - fit.target.col(column);
      sums.head<3>() += error;
      sums.tail<3>() += fit.arm.col(column).cross(error);
    }
    y.segment<6>(6 * static_cast<Eigen::Index>(p)) = fit.weight * sums;
  }
  return y;
}

void PlateErrors::transpose(const PoseVectorOf<double>& y, std::span<double> w) const {
  std::fill(w.begin(), w.end(), 0.0);
  for (std::size_t p = 0; p < kPlates; ++p) {
    const Fit& fit = fits_[p];
    const Vector6 sums = fit.weight.transpose() * y.segment<6>(6 * static_cast<Eigen::Index>(p));
    for (std::size_t i = 0; i < fit.place.size(); ++i) {
      const Eigen::Vector3d arm = fit.arm.col(static_cast<Eigen::Index>(i));
      Eigen::Map<Eigen::Vector3d>(&w[fit.place[i]]) += sums.head<3>() + sums.tail<3>().cross(arm);
    }
  }
}

}  // namespace finsight::host
