#include "hostgen/fem/contact.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "firmware/geometry/so3.h"

namespace finsight::host {

namespace {

// A point load's own dimple is narrower than this; the turn of the face around it is that of the object's seat.
constexpr double kRing_mm = 8;
constexpr int kRingPoints = 12;
constexpr int kDiscSpots = 61;
constexpr int kLineSpots = 31, kLineRows = 3;
// Points of the face are found to within rounding; further away they lie beside it.
constexpr double kBeside_mm = 1e-6;

double pressure_at(Pressure pressure, double r_sq) {
  // Spots lie inside the edge, where a rigid end's pressure is finite.
  if (pressure == Pressure::kRound) return std::sqrt(1 - r_sq);
  return pressure == Pressure::kEven ? 1.0 : 1 / std::sqrt(1 - r_sq);
}

/// A place in a patch, from its centre, and the pressure on it.
struct Sample {
  Eigen::Vector2d offset_mm;
  double pressure;
};

/// Sunflower (Vogel 1979): every spot stands for the same area.
std::vector<Sample> disc(double radius_mm, Pressure pressure) {
  const double kGoldenAngle = std::numbers::pi * (3 - std::sqrt(5.0));
  if (radius_mm == 0) return {{Eigen::Vector2d::Zero(), 1}};
  std::vector<Sample> samples;
  for (int i = 0; i < kDiscSpots; ++i) {
    const double r_sq = (i + 0.5) / kDiscSpots, angle = i * kGoldenAngle;
    const double r_mm = radius_mm * std::sqrt(r_sq);
    samples.push_back({{r_mm * std::cos(angle), r_mm * std::sin(angle)}, pressure_at(pressure, r_sq)});
  }
  return samples;
}

/// Even along its length; across it as `pressure` says.
std::vector<Sample> line(const FaceContact& contact, double half_width_mm) {
  const Eigen::Vector2d along(std::cos(contact.angle_rad), std::sin(contact.angle_rad)), across(-along.y(), along.x());
  std::vector<Sample> samples;
  for (int i = 0; i < kLineSpots; ++i) {
    const double at_mm = contact.half_length_mm * (2 * (i + 0.5) / kLineSpots - 1);
    for (int row = 0; row < kLineRows; ++row) {
      const double share = 2 * (row + 0.5) / kLineRows - 1;
      samples.push_back({at_mm * along + half_width_mm * share * across, pressure_at(contact.pressure, share * share)});
    }
  }
  return samples;
}

}  // namespace

Eigen::Matrix3d face_axes(const Eigen::Vector3d& inward) {
  Eigen::Matrix3d axes;
  axes.col(0) = inward;
  const Eigen::Vector3d x = std::abs(inward.x()) < 0.9 ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitZ();
  axes.col(1) = (x - inward * inward.dot(x)).normalized();
  axes.col(2) = inward.cross(axes.col(1));
  return axes;
}

std::vector<PressureSpot> pressure_spots(const PushedFinger& finger, const FaceContact& contact, double normal_n) {
  if (contact.side != Side::kFront) return {{finger.at(contact.centre_mm, contact.side), 1}};
  const bool is_line = contact.half_length_mm > 0;
  double radius_mm = contact.radius_mm;
  if (contact.pressure == Pressure::kRound) {
    const double force = normal_n / contact.full_force_n;
    radius_mm *= is_line ? std::sqrt(force) : std::cbrt(force);
  }
  std::vector<PressureSpot> spots;
  double sum = 0;
  for (const Sample& sample : is_line ? line(contact, radius_mm) : disc(radius_mm, contact.pressure)) {
    const Eigen::Vector2d place = contact.centre_mm + sample.offset_mm;
    const FacePoint at = finger.at(place);
    if ((at.at_mm.head<2>() - place).norm() > kBeside_mm) continue;
    spots.push_back({at, sample.pressure});
    sum += sample.pressure;
  }
  for (PressureSpot& spot : spots) spot.share /= sum;
  return spots;
}

Eigen::Vector3d spot_force_n(const FaceContact& contact, const PressureSpot& spot, double normal_n,
                             const Eigen::Matrix3d& R) {
  const Eigen::Vector3d direction(1, contact.friction.x(), contact.friction.y());
  return normal_n * spot.share * (R * (face_axes(spot.at.inward) * direction));
}

ContactLoad::ContactLoad(const PushedFinger& finger, const std::vector<FaceContact>& contacts) : finger_(finger) {
  for (const FaceContact& contact : contacts) {
    Patch patch;
    patch.contact = contact;
    for (int i = 0; i < kRingPoints; ++i) {
      const double angle = 2 * std::numbers::pi * i / kRingPoints;
      const Eigen::Vector2d away_mm(kRing_mm * std::cos(angle), kRing_mm * std::sin(angle));
      patch.ring.push_back(finger.at(contact.centre_mm + away_mm, contact.side));
    }
    if (pressure_spots(finger, contact, contact.full_force_n).empty())
      throw std::invalid_argument("contact beside the touched face");
    patches_.push_back(std::move(patch));
  }
}

Eigen::Matrix3d ContactLoad::turn(const Patch& patch, const ElasticState& state) const {
  std::vector<Eigen::Vector3d> rest, now;
  for (const FacePoint& at : patch.ring) {
    rest.push_back(at.at_mm);
    now.push_back(at.at_mm + finger_.displacement(state, at));
  }
  const Eigen::Vector3d rotation = so3_log(rigid_rotation(rest, now));
  return so3_exp(Eigen::Vector3d(patch.contact.follow * rotation));
}

void ContactLoad::forces(double normal_n, const ElasticState& guess, PushedFinger::BodyVector& load) {
  std::fill(load.begin(), load.end(), 0.0);
  for (Patch& patch : patches_) {
    const double share_n = patch.contact.share * normal_n;
    patch.R = turn(patch, guess);
    if (patch.spots.empty() || patch.contact.radius_mm > 0) {
      patch.spots = pressure_spots(finger_, patch.contact, share_n);
      patch.force_n.resize(patch.spots.size());
    }
    for (std::size_t i = 0; i < patch.spots.size(); ++i) {
      patch.force_n[i] = spot_force_n(patch.contact, patch.spots[i], share_n, patch.R);
      finger_.add_force(patch.spots[i].at, patch.force_n[i], load);
    }
  }
}

bool ContactLoad::has_turned(const ElasticState& state) const {
  constexpr double kTolerance_rad = 0.5 * std::numbers::pi / 180;
  return std::ranges::any_of(patches_, [&](const Patch& patch) {
    return so3_log(Eigen::Matrix3d(turn(patch, state) * patch.R.transpose())).norm() > kTolerance_rad;
  });
}

ContactResult ContactLoad::result(const ElasticState& state) const {
  ContactResult result;
  double spread_sq = 0;
  for (const Patch& patch : patches_) {
    for (std::size_t i = 0; i < patch.spots.size(); ++i) {
      const FacePoint& at = patch.spots[i].at;
      const double weight = patch.contact.share * patch.spots[i].share;
      const Eigen::Vector3d now = at.at_mm + finger_.displacement(state, at);
      result.point_mm += weight * at.at_mm;
      result.contact_mm += weight * now;
      result.force_n += patch.force_n[i];
      result.moment_nmm += now.cross(patch.force_n[i]);
      spread_sq += weight * at.at_mm.squaredNorm();
    }
  }
  result.spread_mm = std::sqrt(std::max(0.0, spread_sq - result.point_mm.squaredNorm()));
  return result;
}

}  // namespace finsight::host
