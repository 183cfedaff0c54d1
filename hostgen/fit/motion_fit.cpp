#include "hostgen/fit/motion_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "hostgen/render/virtual_finger.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

using Numbers = PoseVectorOf<double>;

// What fingers of the workshop (see Workshop) differ by once they are zeroed and their mount is measured.
constexpr double kCamera_deg = 0.9, kPrint = 0.01, kDepth = 0.01, kMarker_mm = 0.4, kWall_mm = 0.17;

constexpr double kBeyondRange = 1.5;  // a soft finger bends under a force as its pack's does under more
constexpr double kOtherWall_mm = 0.3;
constexpr int kWallLevels = 10, kFirstLevel = 2;

// Up to which motions are alike: noise that remains in a mean, and what no deviation describes, as a share of how far
// the plates move. Rotations of an arm of 80 mm.
constexpr double kNoise_mm = 0.02, kNoise_rad = 0.001, kUndescribed = 0.01, kArm_mm = 80;

Numbers tolerance_of(const Numbers& motion) {
  const double furthest_mm = plate_motion_mm(motion);
  Numbers tolerance;
  for (int p = 0; p < kPlates; ++p) {
    const double moved_mm = std::max(motion.segment<3>(6 * p).norm(), furthest_mm / 2);
    const double turned_rad = std::max(motion.segment<3>(6 * p + 3).norm(), furthest_mm / kArm_mm);
    tolerance.segment<3>(6 * p).fill(kNoise_mm + kUndescribed * moved_mm);
    tolerance.segment<3>(6 * p + 3).fill(kNoise_rad + kUndescribed * turned_rad);
  }
  return tolerance;
}

/// What tells one motion at a place from those of other forces at the same place, in units of the tolerance.
class BesidesForce {
 public:
  BesidesForce(const PressedPlace& place, double force_n) : tolerance_(tolerance_of(place.motion(force_n))) {
    constexpr double kStep = 0.02;
    const Numbers more = place.motion((1 + kStep) * force_n) - place.motion((1 - kStep) * force_n);
    along_ = more.cwiseQuotient(tolerance_).normalized();
  }
  const Numbers& tolerance() const { return tolerance_; }
  Numbers operator()(const Numbers& motion) const {
    const Numbers scaled = motion.cwiseQuotient(tolerance_);
    return scaled - along_ * along_.dot(scaled);
  }

 private:
  Numbers tolerance_, along_;
};

Eigen::Matrix3d cross(int axis) {
  const Eigen::Vector3d with = Eigen::Vector3d::Unit(axis);
  Eigen::Matrix3d product;
  for (int column = 0; column < 3; ++column) product.col(column) = with.cross(Eigen::Vector3d::Unit(column));
  return product;
}

// A turned camera turns all motions; a print that is too small makes them larger, a wrong focal length only those along
// the line of sight. A marker beside its place moves with what its plate turns there.
std::vector<Deviation> of_camera_and_markers(const FingerSpec& spec) {
  const std::array<std::string, 3> axes = {"x", "y", "z"}, plates = {"top", "middle", "low"};
  std::vector<Deviation> found;
  for (int axis = 0; axis < 3; ++axis) {
    Deviation turned{
        .name = "camera turned about " + axes[static_cast<std::size_t>(axis)], .unit = "deg", .usual = kCamera_deg};
    const Eigen::Matrix3d per_deg = std::numbers::pi / 180 * cross(axis);
    for (int k = 0; k < 2 * kPlates; ++k) turned.change.block<3, 3>(3 * k, 3 * k) = per_deg;
    found.push_back(turned);
  }
  const Eigen::Vector3d sight = spec.T_finger_camera.linear().col(2);
  Deviation print{.name = "print too small", .unit = "%", .usual = 100 * kPrint},
      depth{.name = "depth exaggerated", .unit = "%", .usual = 100 * kDepth};
  for (int p = 0; p < kPlates; ++p) {
    print.change.block<3, 3>(6 * p, 6 * p) = 0.01 * Eigen::Matrix3d::Identity();
    depth.change.block<3, 3>(6 * p, 6 * p) = 0.01 * sight * sight.transpose();
  }
  found.push_back(print);
  found.push_back(depth);
  for (int p = 0; p < kPlates; ++p) {
    for (int axis = 0; axis < 3; ++axis) {
      Deviation beside{.name = plates[static_cast<std::size_t>(p)] + " marker beside its place, " +
                               axes[static_cast<std::size_t>(axis)],
                       .unit = "mm",
                       .usual = kMarker_mm};
      beside.change.block<3, 3>(6 * p, 6 * p + 3) = -cross(axis);
      found.push_back(beside);
    }
  }
  return found;
}

/// How a wall that is thicker by 1 mm changes motions, as a linear function of them: least squares over the holes.
MotionChange change_of(const std::vector<PressedPlace>& usual, std::span<const PressedPlace> other) {
  constexpr double kRidge_mm = 0.017, kRidge_rad = 0.0017;  // as if a motion that small had not been changed
  Numbers ridge;
  for (int p = 0; p < kPlates; ++p) {
    ridge.segment<3>(6 * p).fill(kRidge_mm);
    ridge.segment<3>(6 * p + 3).fill(kRidge_rad);
  }
  MotionChange normal = ridge.cwiseAbs2().asDiagonal(), right = MotionChange::Zero();
  for (std::size_t hole = 0; hole < usual.size(); ++hole) {
    const double highest_n = std::min(usual[hole].highest_n(), other[hole].highest_n());
    for (int level = kFirstLevel; level <= kWallLevels && highest_n > 0; ++level) {
      const double force_n = highest_n * level / kWallLevels;
      const Numbers motion = usual[hole].motion(force_n);
      const BesidesForce besides(usual[hole], force_n);
      const Numbers changed = besides(other[hole].motion(force_n) - motion).cwiseProduct(besides.tolerance());
      const double weight = 1 / (plate_motion_mm(motion) * plate_motion_mm(motion));
      normal += weight * motion * motion.transpose();
      right += weight * changed * motion.transpose();
    }
  }
  return normal.ldlt().solve(right.transpose()).transpose() / kOtherWall_mm;
}

double nearest_force_n(const PressedPlace& place, const Numbers& motion) {
  constexpr int kSteps = 400;
  const Numbers tolerance = tolerance_of(motion);
  double nearest = std::numeric_limits<double>::infinity(), found_n = 0;
  for (int i = 1; i <= kSteps; ++i) {
    const double force_n = place.highest_n() * i / kSteps;
    const double distance = (motion - place.motion(force_n)).cwiseQuotient(tolerance).squaredNorm();
    if (distance < nearest) {
      nearest = distance;
      found_n = force_n;
    }
  }
  return found_n;
}

}  // namespace

MotionBasis motion_basis(const FingerSpec& spec, const std::vector<JigHole>& holes) {
  MotionBasis basis{.holes = {}, .deviations = of_camera_and_markers(spec)};
  std::vector<FingerSpec> specs = {spec};
  const bool has_walls = !spec.surface;
  if (has_walls) {
    specs.push_back(with_walls(spec, kOtherWall_mm, 0, 0));
    specs.push_back(with_walls(spec, 0, kOtherWall_mm, 0));
    specs.push_back(with_walls(spec, 0, 0, kOtherWall_mm));
  }
  std::vector<std::shared_ptr<const PushedFinger>> fingers;
  for (const FingerSpec& one : specs) fingers.push_back(std::make_shared<const PushedFinger>(one, make_mesh(one)));
  std::vector<std::optional<PressedPlace>> places(fingers.size() * holes.size());
  Progress progress("the pack's finger at the holes", places.size());
  parallel_for(places.size(), [&](std::size_t i) {
    FingerStatics statics(fingers[i / holes.size()]);
    places[i].emplace(statics, holes[i % holes.size()].contact_mm.cast<float>(), kBeyondRange * spec.force_n[1]);
    progress.advance();
  });
  std::vector<PressedPlace> solved;
  for (auto& place : places) solved.push_back(std::move(*place));
  basis.holes.assign(solved.begin(), solved.begin() + static_cast<std::ptrdiff_t>(holes.size()));
  const std::array<const char*, 3> walls = {"front wall thicker", "back wall thicker", "side walls thicker"};
  for (std::size_t wall = 0; wall < walls.size() && has_walls; ++wall) {
    const auto other = std::span<const PressedPlace>(solved).subspan((wall + 1) * holes.size(), holes.size());
    basis.deviations.push_back({walls[wall], "mm", kWall_mm, change_of(basis.holes, other)});
  }
  return basis;
}

MotionFit fit_motions(const MotionBasis& basis, std::span<const SeenMotion> seen) {
  constexpr int kRounds = 3;  // of finding the forces, too
  const auto count = static_cast<Eigen::Index>(basis.deviations.size());
  Eigen::VectorXd information(count);
  for (Eigen::Index k = 0; k < count; ++k) {
    information[k] = std::pow(basis.deviations[static_cast<std::size_t>(k)].usual, -2);
  }
  MotionFit fit;
  fit.force_n.resize(seen.size());
  for (int round = 0; round < kRounds; ++round) {
    Eigen::MatrixXd of_weights = Eigen::MatrixXd::Zero(count, count);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(count);
    double seen_sq = 0;
    Eigen::Index told = 0;
    for (std::size_t i = 0; i < seen.size(); ++i) {
      const PressedPlace& place = basis.holes[seen[i].hole];
      if (!(place.highest_n() > 0)) continue;
      fit.force_n[i] = nearest_force_n(place, seen[i].motion + fit.correction * seen[i].motion);
      const Numbers pressed = place.motion(fit.force_n[i]);
      const BesidesForce besides(place, fit.force_n[i]);
      Eigen::MatrixXd columns(kPoseDims, count);
      for (Eigen::Index k = 0; k < count; ++k) {
        columns.col(k) = besides(basis.deviations[static_cast<std::size_t>(k)].change * pressed);
      }
      const Numbers off = besides(seen[i].motion - pressed);
      of_weights += columns.transpose() * columns;
      right += columns.transpose() * off;
      seen_sq += off.squaredNorm();
      told += kPoseDims - 1;
    }
    const Eigen::MatrixXd covariance = (of_weights + Eigen::MatrixXd(information.asDiagonal())).inverse();
    const Eigen::VectorXd amount = covariance * right, sigma = covariance.diagonal().cwiseSqrt();
    fit.amount.assign(amount.begin(), amount.end());
    fit.sigma.assign(sigma.begin(), sigma.end());
    const double left_sq = seen_sq - 2 * amount.dot(right) + amount.dot(of_weights * amount);
    const double open_sq = (covariance * of_weights).trace();
    fit.unlike = told == 0 ? 0 : kUndescribed * std::sqrt((left_sq + open_sq) / static_cast<double>(told));
    fit.correction.setZero();
    for (Eigen::Index k = 0; k < count; ++k) {
      fit.correction -= amount[k] * basis.deviations[static_cast<std::size_t>(k)].change;
    }
  }
  return fit;
}

}  // namespace finsight::host
