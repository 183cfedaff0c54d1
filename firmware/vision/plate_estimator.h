// All plate motions at once from all corners: the most probable ones given what the camera sees and how
// touched fingers move.
#pragma once

#include "firmware/model/model.h"
#include "firmware/vision/ippe.h"

namespace finsight {

/// Prior standard deviation of a corner: 0.02 to 0.03 pixels are measured in rendered images with the blur and noise of
/// a good camera; the rest allows for the lens calibration and the print.
inline constexpr double kCornerSigmaPx = 0.05;
/// Corners nearer to the lens than this are not projected.
inline constexpr double kNearestMm = 1;

/// Of a corner's squared residual, which is this many squared standard deviations: pseudo-Huber's, which falls where a
/// corner lies further off than noise moves it.
double corner_weight(double sigmas_sq);

/// What the camera sees of the plates: the rays to the corners of every seen marker, and how much they scatter.
struct PlateSight {
  std::array<bool, kPlates> seen{};
  std::array<MarkerRays, kPlates> rays;
  double corner_sigma_px = kCornerSigmaPx;
  std::array<double, kPlates> scatter = {1, 1, 1};  ///< of each marker's corners, relative to corner_sigma_px
};

/// Maximises p(corners | motions) p(motions): motions follow the pack's Gaussian, corners a distribution that is normal
/// with corner_sigma_px near the middle and whose tails keep a corner that dirt has moved far off from dominating. A
/// plate that is not seen has no residuals; the prior alone places it, given the others. Nothing here allocates.
class PlateEstimator {
 public:
  using Vector = PoseVectorOf<double>;

  /// `focal_px` turns angles into pixels. Throws InputError for a prior that is not a positive definite Gaussian.
  PlateEstimator(const MountModel& mount, const PlatePrior& prior, double focal_px);

  /// Where this finger's plates rest, which the prior's motions are counted from; at first as the model's do.
  void set_rest(const ZeroPose& rest);
  const Vector& prior_mean() const { return touched_.mean; }
  /// One Gauss-Newton step from `motion`, each corner weighted by its residual there.
  void gauss_newton_step(const PlateSight& sight, Vector& motion) const;
  /// Steps from `start`, then the corners' scatter (into `sight`), then two steps more with it.
  Vector estimate(PlateSight& sight, const Vector& start, int steps) const;
  /// Some steps more for a finger that nothing touches: instead of the pack's prior, how far from the model's rest
  /// cameras and markers are mounted.
  Vector estimate_at_rest(const PlateSight& sight, const Vector& start) const;
  /// The corners' scatter, estimated from the part of their residuals that no motion explains: two residuals per seen
  /// marker; the prior kCornerSigmaPx counts as four more.
  double corner_sigma_px(const PlateSight& sight, const Vector& motion) const;
  /// Standard deviations at the estimate, from the inverse of the normal equations: per plate the RMS of its six over
  /// those of the pack (PlatePrior::noise).
  std::array<float, kPlates> noise(const PlateSight& sight, const Vector& motion) const;
  /// Covariance of one seen plate's six numbers by its own corners alone, without the prior. Not finite where they do
  /// not tell.
  Eigen::Matrix<double, 6, 6> covariance_of_corners(const PlateSight& sight, std::size_t plate,
                                                    const Vector& motion) const;
  /// Twice the negative log probability, without its constant; infinite if a corner is not in front of the camera.
  double cost(const PlateSight& sight, const Vector& motion) const;
  /// RMS distance of a seen plate's four corners from where `motion` puts them; infinite behind the camera.
  double reprojection_px(const PlateSight& sight, std::size_t plate, const Vector& motion) const;
  /// Mahalanobis distance of one plate's motion from the prior, whatever the other plates do, with 3 mm and 0.15 rad of
  /// slack: fingers are also shaken and pushed from sides that the prior's fingers never were.
  double distance_from_prior(std::size_t plate, const Vector& motion) const;
  /// Where a marker's corner is in the camera frame after this motion.
  Eigen::Vector3d corner_in_camera(std::size_t plate, std::size_t corner, const Vector& motion) const;
  /// A plate's displacement and rotation vector if its marker is at this place.
  Eigen::Matrix<double, 6, 1> motion(std::size_t plate, const Eigen::Isometry3d& T_camera_marker) const;

 private:
  using Matrix = Eigen::Matrix<double, kPoseDims, kPoseDims>;
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  struct Gaussian {
    Vector mean;
    Matrix precision;
  };
  struct PlateAtRest {
    Eigen::Vector3d centre;  ///< of the marker, finger frame
    Eigen::Matrix3d R_finger_marker;
    std::array<Eigen::Vector3d, 4> corner;  ///< from the centre, finger frame
    Matrix6 loose_precision;                ///< inverse of this plate's covariance with the slack
  };
  bool add_plate(const PlateSight& sight, std::size_t plate, const Vector& motion, Matrix6& information,
                 Vector6& gradient, double& residual_sq) const;
  void normal_equations(const PlateSight& sight, const Gaussian& prior, const Vector& motion, Matrix& information,
                        Vector& gradient) const;
  void step(const PlateSight& sight, const Gaussian& prior, Vector& motion) const;
  bool reproject(const PlateSight& sight, std::size_t plate, const Vector& motion,
                 std::array<double, 4>& distance_px) const;

  std::array<PlateAtRest, kPlates> rest_;
  Eigen::Isometry3d T_camera_finger_, T_finger_camera_;
  double focal_px_;
  Gaussian touched_, resting_;  ///< motions of fingers that are touched, and that are not
  Vector model_mean_;           ///< of touched_, from the model's rest
  Vector noise_;
};

}  // namespace finsight
