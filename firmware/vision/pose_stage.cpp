#include "firmware/vision/pose_stage.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "firmware/model/plate_prior.h"

namespace finsight {
namespace {

constexpr double kLargestReprojectionPx = 3;
constexpr double kFarthestSigmas = 6;  // from the prior with its slack
// From IPPE's pose Gauss-Newton converges quadratically: after five steps the motions stand still to 1e-9.
constexpr int kSteps = 5;

/// Of corners, relative to kCornerSigmaPx: what the pictures' noise adds to what is expected of any picture.
double scatter_of(const EdgeQuality& edges) {
  return std::hypot(1.0, static_cast<double>(edges.scatter_px) / kCornerSigmaPx);
}

const Lens& checked(const Lens& camera) {
  check_lens(camera);
  return camera;
}

}  // namespace

PoseStage::PoseStage(const MountModel& mount, const PlatePrior& prior, const Lens& camera, PoseMethod method)
    : camera_(checked(camera)),
      marker_size_mm_(mount.marker_size_mm),
      prior_(prior),
      estimator_(mount, prior, camera.fx),
      rigid_motion_(mount, camera.fx),
      method_(method),
      turning_radius_sq_(turning_radius_sq(camera)) {}

const PlatePoses& PoseStage::estimate(const MarkerCorners& corners, const std::array<EdgeQuality, kPlates>& edges) {
  unproject_corners(corners, edges);
  poses_ = PlatePoses{};
  // A plate in an impossible place pulls the others along, so the worst one is left out and the rest estimated again.
  Vector motion;
  do {
    if (!sight_.seen[0] && !sight_.seen[1] && !sight_.seen[2]) return poses_;
    motion = method_ == PoseMethod::kJoint ? estimate_jointly() : estimate_one_by_one();
  } while (drop_worst(motion));

  motion_ = motion;
  poses_.seen = sight_.seen;
  poses_.quality = Quality::kFresh;
  for (std::size_t p = 0; p < kPlates; ++p) {
    const int first = 6 * static_cast<int>(p);
    poses_.plates[p].displacement_mm = motion.segment<3>(first).cast<float>();
    poses_.plates[p].rotation_rad = motion.segment<3>(first + 3).cast<float>();
    if (poses_.seen[p]) {
      poses_.reprojection_px[p] = static_cast<float>(estimator_.reprojection_px(sight_, p, motion));
    }
  }
  if (method_ == PoseMethod::kPublished) {
    complete_from_prior(prior_, poses_);
  } else {
    poses_.noise = estimator_.noise(sight_, motion);
  }
  return poses_;
}

std::optional<std::array<Vec2f, 4>> PoseStage::expected_corners(std::size_t plate) const {
  std::array<Vec2f, 4> corners;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d seen = estimator_.corner_in_camera(plate, k, motion_);
    const Eigen::Vector2d ray = seen.head<2>() / seen.z();
    if (!(seen.z() > 0 && ray.squaredNorm() < turning_radius_sq_)) return std::nullopt;
    corners[k] = pixel_from_ray(camera_, ray).cast<float>();
  }
  return corners;
}

// Corners -> lines of sight -> the two poses of each square.
void PoseStage::unproject_corners(const MarkerCorners& corners, const std::array<EdgeQuality, kPlates>& edges) {
  for (std::size_t p = 0; p < kPlates; ++p) {
    sight_.seen[p] = false;
    if (!corners.seen[p]) continue;
    sight_.scatter[p] = scatter_of(edges[p]);
    for (std::size_t k = 0; k < 4; ++k) {
      sight_.rays[p][k] = ray_from_pixel(camera_, corners.corners_px[p][k].cast<double>());
    }
    squares_[p] = poses_of_square(sight_.rays[p], marker_size_mm_);
    sight_.seen[p] = squares_[p].count > 0;
  }
}

// A square seen almost face-on has two poses of nearly the same reprojection error, mirror images in tilt. Of the up to
// eight combinations the prior knows the right one; one step from each is enough to compare them, because it brings the
// noisy tilts of small squares to where corners and prior together want them.
PoseStage::Vector PoseStage::estimate_jointly() {
  sight_.corner_sigma_px = kCornerSigmaPx;
  Vector best = Vector::Constant(std::numeric_limits<double>::quiet_NaN());
  double best_cost = std::numeric_limits<double>::infinity();
  for (unsigned combination = 0; combination < 1U << kPlates; ++combination) {
    Vector motion = estimator_.prior_mean();
    bool possible = true;
    for (std::size_t p = 0; p < kPlates; ++p) {
      const int choice = static_cast<int>(combination >> p & 1U);
      possible &= choice < (sight_.seen[p] ? squares_[p].count : 1);
      if (!possible) break;
      if (!sight_.seen[p]) continue;
      const Eigen::Isometry3d& pose = squares_[p].T_camera_marker[static_cast<std::size_t>(choice)];
      motion.segment<6>(6 * static_cast<int>(p)) = estimator_.motion(p, pose);
    }
    if (!possible) continue;
    estimator_.gauss_newton_step(sight_, motion);
    const double cost = estimator_.cost(sight_, motion);
    if (cost < best_cost) {
      best_cost = cost;
      best = motion;
    }
  }
  best = estimator_.estimate(sight_, best, kSteps);
  return is_at_rest_ ? estimator_.estimate_at_rest(sight_, best) : best;
}

PoseStage::Vector PoseStage::estimate_one_by_one() const {
  Vector motion = estimator_.prior_mean();
  for (std::size_t p = 0; p < kPlates; ++p) {
    if (!sight_.seen[p]) continue;
    motion.segment<6>(6 * static_cast<int>(p)) = estimator_.motion(p, squares_[p].T_camera_marker[0]);
  }
  return motion;
}

// True if a plate had to be left out. Comparisons are written so that NaN counts as the worst.
bool PoseStage::drop_worst(const Vector& motion) {
  double worst = 1;
  std::size_t worst_plate = kPlates;
  for (std::size_t p = 0; p < kPlates; ++p) {
    if (!sight_.seen[p]) continue;
    double excess = estimator_.reprojection_px(sight_, p, motion) / kLargestReprojectionPx;
    if (method_ == PoseMethod::kJoint) {
      excess = std::max(excess, estimator_.distance_from_prior(p, motion) / kFarthestSigmas);
    }
    if (!(excess <= worst)) {
      worst = excess;
      worst_plate = p;
    }
  }
  if (worst_plate == kPlates) return false;
  sight_.seen[worst_plate] = false;
  return true;
}

}  // namespace finsight
