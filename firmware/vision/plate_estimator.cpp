#include "firmware/vision/plate_estimator.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "firmware/geometry/so3.h"
#include "firmware/input_error.h"
#include "firmware/model/rest_spread.h"

namespace finsight {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kSlackMm = 3, kSlackRad = 0.15;
// How far from the model's rest a marker may rest by itself: how it is stuck on, and the finger's own shape.
constexpr double kOwnRestMm = 0.3, kOwnRestRad = 0.04;
// Corners further off than this pull with a constant force. Pseudo-Huber is convex, so the prior cannot outvote the
// corners of a finger that is where no touch brings it.
constexpr double kLinearFromSigmas = 3;
constexpr double kGuessWeight = 4;    // of the guessed scatter, in residuals
constexpr int kStepsWithScatter = 2;  // the scatter changes little: only the corners' weight against the prior
constexpr int kStepsAtRest = 3;       // from the estimate with the pack's prior, which is near
constexpr double kMinSigmaPx = 0.01, kMaxSigmaPx = 1;

}  // namespace

double corner_weight(double sigmas_sq) {
  return 1 / std::sqrt(1 + sigmas_sq / (kLinearFromSigmas * kLinearFromSigmas));
}

PlateEstimator::PlateEstimator(const MountModel& mount, const PlatePrior& prior, double focal_px)
    : T_camera_finger_(mount.T_finger_camera.cast<double>().inverse()),
      T_finger_camera_(mount.T_finger_camera.cast<double>()),
      focal_px_(focal_px) {
  if (prior.mean.size() != kPoseDims || prior.covariance.size() != kPoseDims * kPoseDims ||
      prior.noise.size() != kPoseDims) {
    throw InputError("prior", "size",
                     std::to_string(prior.mean.size()) + ", " + std::to_string(prior.covariance.size()) + " and " +
                         std::to_string(prior.noise.size()) + " numbers",
                     "18, 324 and 18");
  }
  noise_ = Eigen::Map<const PoseVector>(prior.noise.data()).cast<double>();
  model_mean_ = touched_.mean = Eigen::Map<const PoseVector>(prior.mean.data()).cast<double>();
  const Matrix covariance =
      Eigen::Map<const Eigen::Matrix<float, kPoseDims, kPoseDims>>(prior.covariance.data()).cast<double>();
  const Eigen::LLT<Matrix> factor(covariance);
  if (!model_mean_.allFinite() || !covariance.allFinite() || factor.info() != Eigen::Success) {
    throw InputError("prior", "covariance", "a matrix that is not positive definite", "a Gaussian's covariance");
  }
  touched_.precision = factor.solve(Matrix::Identity());
  const auto common = common_rest_spread(mount);
  Matrix resting = common * common.transpose();
  resting.diagonal() += own_rest_variance(kOwnRestMm, kOwnRestRad);
  resting_ = {Vector::Zero(), resting.llt().solve(Matrix::Identity())};
  for (std::size_t p = 0; p < kPlates; ++p) {
    const Eigen::Isometry3d T_finger_marker = mount.T_finger_marker[p].cast<double>();
    PlateAtRest& rest = rest_[p];
    rest.centre = T_finger_marker.translation();
    rest.R_finger_marker = T_finger_marker.linear();
    for (std::size_t k = 0; k < 4; ++k) rest.corner[k] = rest.R_finger_marker * marker_corner(mount.marker_size_mm, k);
    const int first = 6 * static_cast<int>(p);
    Matrix6 loose = covariance.block<6, 6>(first, first);
    loose.diagonal().head<3>().array() += kSlackMm * kSlackMm;
    loose.diagonal().tail<3>().array() += kSlackRad * kSlackRad;
    rest.loose_precision = loose.inverse();
  }
}

Eigen::Matrix<double, 6, 1> PlateEstimator::motion(std::size_t plate, const Eigen::Isometry3d& T_camera_marker) const {
  const Eigen::Isometry3d T_finger_marker = T_finger_camera_ * T_camera_marker;
  Vector6 motion;
  motion.head<3>() = T_finger_marker.translation() - rest_[plate].centre;
  motion.tail<3>() = so3_log(T_finger_marker.linear() * rest_[plate].R_finger_marker.transpose());
  return motion;
}

// Corner X of the plate at rest, seen from its centre c, is now at exp(w) X + c + d. The camera sees it along
// (x / z, y / z); the residual is the difference from the measured ray, in units of the corners' scatter.
bool PlateEstimator::add_plate(const PlateSight& sight, std::size_t plate, const Vector& motion, Matrix6& information,
                               Vector6& gradient, double& residual_sq) const {
  const Vector3d d = motion.segment<3>(6 * static_cast<int>(plate));
  const Vector3d w = motion.segment<3>(6 * static_cast<int>(plate) + 3);
  const Matrix3d R = so3_exp(w), left_jacobian = so3_left_jacobian(w);
  const double scale = focal_px_ / (sight.corner_sigma_px * sight.scatter[plate]);
  information.setZero();
  gradient.setZero();
  for (std::size_t k = 0; k < 4; ++k) {
    const Vector3d arm = R * rest_[plate].corner[k];
    const Vector3d seen = T_camera_finger_ * (arm + rest_[plate].centre + d);
    if (!(seen.z() > kNearestMm)) return false;
    const Vector2d ray = seen.head<2>() / seen.z();
    Eigen::Matrix<double, 2, 3> by_place;  // d ray / d place in the finger frame
    by_place << 1, 0, -ray.x(), 0, 1, -ray.y();
    by_place = (by_place * T_camera_finger_.linear() / seen.z()).eval();
    Eigen::Matrix<double, 2, 6> jacobian;
    jacobian << by_place, -by_place * cross_matrix(arm) * left_jacobian;
    jacobian *= scale;
    const Vector2d residual = scale * (ray - sight.rays[plate][k]);
    const double weight = corner_weight(residual.squaredNorm());
    residual_sq += weight * residual.squaredNorm();
    information.noalias() += weight * jacobian.transpose() * jacobian;
    gradient.noalias() += weight * jacobian.transpose() * residual;
  }
  return true;
}

void PlateEstimator::normal_equations(const PlateSight& sight, const Gaussian& prior, const Vector& motion,
                                      Matrix& information, Vector& gradient) const {
  information = prior.precision;
  gradient = prior.precision * (motion - prior.mean);
  for (std::size_t p = 0; p < kPlates; ++p) {
    Matrix6 plate_information;
    Vector6 plate_gradient;
    double residual_sq = 0;
    if (!sight.seen[p] || !add_plate(sight, p, motion, plate_information, plate_gradient, residual_sq)) continue;
    const int first = 6 * static_cast<int>(p);
    information.block<6, 6>(first, first) += plate_information;
    gradient.segment<6>(first) += plate_gradient;
  }
}

void PlateEstimator::step(const PlateSight& sight, const Gaussian& prior, Vector& motion) const {
  Matrix information;
  Vector gradient;
  normal_equations(sight, prior, motion, information, gradient);
  motion -= information.llt().solve(gradient);
}

void PlateEstimator::gauss_newton_step(const PlateSight& sight, Vector& motion) const { step(sight, touched_, motion); }

PlateEstimator::Vector PlateEstimator::estimate(PlateSight& sight, const Vector& start, int steps) const {
  Vector motion = start;
  for (int step = 0; step < steps; ++step) gauss_newton_step(sight, motion);
  sight.corner_sigma_px = corner_sigma_px(sight, motion);
  for (int step = 0; step < kStepsWithScatter; ++step) gauss_newton_step(sight, motion);
  return motion;
}

PlateEstimator::Vector PlateEstimator::estimate_at_rest(const PlateSight& sight, const Vector& start) const {
  Vector motion = start;
  for (int k = 0; k < kStepsAtRest; ++k) step(sight, resting_, motion);
  return motion;
}

void PlateEstimator::set_rest(const ZeroPose& rest) {
  for (std::size_t p = 0; p < kPlates; ++p) {
    const int first = 6 * static_cast<int>(p);
    const Vector3d w = model_mean_.segment<3>(first + 3), w_rest = rest[p].rotation_rad.cast<double>();
    touched_.mean.segment<3>(first) = model_mean_.segment<3>(first) + rest[p].displacement_mm.cast<double>();
    touched_.mean.segment<3>(first + 3) = so3_log(so3_exp(w) * so3_exp(w_rest));
  }
}

Vector3d PlateEstimator::corner_in_camera(std::size_t plate, std::size_t corner, const Vector& motion) const {
  const int first = 6 * static_cast<int>(plate);
  const Vector3d d = motion.segment<3>(first);
  const Matrix3d R = so3_exp(motion.segment<3>(first + 3));
  return T_camera_finger_ * (R * rest_[plate].corner[corner] + rest_[plate].centre + d);
}

// Where a plate's corners are seen, and how far from where they should be; false behind the camera.
bool PlateEstimator::reproject(const PlateSight& sight, std::size_t plate, const Vector& motion,
                               std::array<double, 4>& distance_px) const {
  const Vector3d d = motion.segment<3>(6 * static_cast<int>(plate));
  const Matrix3d R = so3_exp(motion.segment<3>(6 * static_cast<int>(plate) + 3));
  for (std::size_t k = 0; k < 4; ++k) {
    const Vector3d seen = T_camera_finger_ * (R * rest_[plate].corner[k] + rest_[plate].centre + d);
    if (!(seen.z() > kNearestMm)) return false;
    distance_px[k] = focal_px_ * (seen.head<2>() / seen.z() - sight.rays[plate][k]).norm();
  }
  return true;
}

double PlateEstimator::reprojection_px(const PlateSight& sight, std::size_t plate, const Vector& motion) const {
  std::array<double, 4> distance_px;
  if (!reproject(sight, plate, motion, distance_px)) return std::numeric_limits<double>::infinity();
  double sum = 0;
  for (const double distance : distance_px) sum += distance * distance;
  return std::sqrt(sum / 4);
}

double PlateEstimator::cost(const PlateSight& sight, const Vector& motion) const {
  constexpr double kScaleSq = kLinearFromSigmas * kLinearFromSigmas;
  double sum = (motion - touched_.mean).dot(touched_.precision * (motion - touched_.mean));
  for (std::size_t p = 0; p < kPlates; ++p) {
    if (!sight.seen[p]) continue;
    std::array<double, 4> distance_px;
    if (!reproject(sight, p, motion, distance_px)) return std::numeric_limits<double>::infinity();
    for (const double distance : distance_px) {
      sum += 2 * kScaleSq *
             (std::sqrt(1 + std::pow(distance / (sight.corner_sigma_px * sight.scatter[p]), 2) / kScaleSq) - 1);
    }
  }
  return sum;
}

// Only what no motion of the plate explains counts, so that a pull of the prior is not taken for scatter: of the eight
// residuals of a square two are left, r^T r - r^T J (J^T J)^-1 J^T r, all in units of the present scatter.
double PlateEstimator::corner_sigma_px(const PlateSight& sight, const Vector& motion) const {
  double left = kGuessWeight, sum_sq = kGuessWeight * kCornerSigmaPx * kCornerSigmaPx;
  for (std::size_t p = 0; p < kPlates; ++p) {
    Matrix6 information;
    Vector6 gradient;
    double residual_sq = 0;
    if (!sight.seen[p] || !add_plate(sight, p, motion, information, gradient, residual_sq)) continue;
    const double unexplained = std::max(0.0, residual_sq - gradient.dot(information.llt().solve(gradient)));
    sum_sq += unexplained * sight.corner_sigma_px * sight.corner_sigma_px;
    left += 2;
  }
  return std::clamp(std::sqrt(sum_sq / left), kMinSigmaPx, kMaxSigmaPx);
}

std::array<float, kPlates> PlateEstimator::noise(const PlateSight& sight, const Vector& motion) const {
  Matrix information;
  Vector gradient;
  normal_equations(sight, touched_, motion, information, gradient);
  const Matrix covariance = information.llt().solve(Matrix::Identity());
  const Vector ratio_sq = covariance.diagonal().cwiseQuotient(noise_.cwiseAbs2());
  std::array<float, kPlates> noise;
  for (std::size_t p = 0; p < kPlates; ++p) {
    noise[p] = static_cast<float>(std::sqrt(ratio_sq.segment<6>(6 * static_cast<int>(p)).mean()));
  }
  return noise;
}

Eigen::Matrix<double, 6, 6> PlateEstimator::covariance_of_corners(const PlateSight& sight, std::size_t plate,
                                                                  const Vector& motion) const {
  Matrix6 information;
  Vector6 gradient;
  double residual_sq = 0;
  if (!add_plate(sight, plate, motion, information, gradient, residual_sq)) information.setZero();
  return information.inverse();
}

double PlateEstimator::distance_from_prior(std::size_t plate, const Vector& motion) const {
  const int first = 6 * static_cast<int>(plate);
  const Vector6 off = motion.segment<6>(first) - touched_.mean.segment<6>(first);
  return std::sqrt(off.dot(rest_[plate].loose_precision * off));
}

}  // namespace finsight
