// A contact of the touched face with an object: where it is, how its pressure is spread, and where its force points.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "hostgen/fem/pushed_finger.h"

namespace finsight::host {

/// How the pressure falls from the middle of a patch to its edge, as the power of 1 - r^2: what contact mechanics gives
/// for a round body (Hertz 1881), for equal pressure (a soft pad), and for a rigid flat end (Boussinesq 1885).
enum class Pressure { kRound, kEven, kFlatEnd };

struct FaceContact {
  Side side = Side::kFront;                             ///< elsewhere it is a point
  Eigen::Vector2d centre_mm = Eigen::Vector2d::Zero();  ///< of the undeformed finger, on the face x and y (side_axes)
  double half_length_mm = 0;                            ///< of a line: half of it; 0: the patch is a disc
  double radius_mm = 0;     ///< of the disc, or half the line's width, at `full_force_n`; 0: a point, or a thin line
  double angle_rad = 0;     ///< of the line, from the finger's x towards y
  double full_force_n = 1;  ///< patches of round bodies grow with the root that Hertz gives: cube root, square root
  Pressure pressure = Pressure::kRound;
  /// Friction: tangential force over normal force, across the finger (x) and along it (away from the base).
  Eigen::Vector2d friction = Eigen::Vector2d::Zero();
  /// How much of the face's turn the force goes along with: 1 keeps its direction to the face, 0 to the base.
  double follow = 1;
  double share = 1;  ///< of the normal forces of all contacts
};

/// The directions in which forces on a face are told, at rest: columns inward normal, across (x; on the sides z),
/// along.
Eigen::Matrix3d face_axes(const Eigen::Vector3d& inward);

/// What contacts do to a finger in one state. Forces in N, moments in N mm about the finger frame's origin.
struct ContactResult {
  Eigen::Vector3d point_mm = Eigen::Vector3d::Zero();    ///< centre of pressure, on the undeformed face
  Eigen::Vector3d contact_mm = Eigen::Vector3d::Zero();  ///< where it is now
  Eigen::Vector3d force_n = Eigen::Vector3d::Zero();     ///< in the finger frame
  Eigen::Vector3d moment_nmm = Eigen::Vector3d::Zero();
  double spread_mm = 0;  ///< RMS distance of the pressure from its centre
};

/// A place of a patch: its share of the patch's normal force.
struct PressureSpot {
  FacePoint at;
  double share = 0;
};
/// How the pressure of one contact is spread at this normal force; the shares sum to 1. Parts of the patch that lie
/// beside the face carry nothing; empty if all of it does.
std::vector<PressureSpot> pressure_spots(const PushedFinger& finger, const FaceContact& contact, double normal_n);

/// The spot's part of the contact's force (N, finger frame) at this normal force, where the face has turned by `R`.
Eigen::Vector3d spot_force_n(const FaceContact& contact, const PressureSpot& spot, double normal_n,
                             const Eigen::Matrix3d& R);

/// The load of some contacts on one finger.
class ContactLoad {
 public:
  /// `finger` must outlive this. Throws std::invalid_argument where a contact does not touch the face at all.
  ContactLoad(const PushedFinger& finger, const std::vector<FaceContact>& contacts);

  /// The nodal forces for normal forces that sum to `normal_n`, directed as the face stands in `guess`. Whoever solves
  /// for an equilibrium with them solves again if the face has turned: for each solve they are dead loads, which keeps
  /// the tangent symmetric.
  void forces(double normal_n, const ElasticState& guess, PushedFinger::BodyVector& load);
  /// Whether the face stands otherwise in `state`, by more than half a degree, than in the guess of forces().
  bool has_turned(const ElasticState& state) const;
  /// Of the load that forces() made last, in the state that it led to.
  ContactResult result(const ElasticState& state) const;

 private:
  struct Patch {
    FaceContact contact;
    std::vector<FacePoint> ring;                      ///< whose motion tells how the face has turned here
    Eigen::Matrix3d R = Eigen::Matrix3d::Identity();  ///< that forces() used last
    std::vector<PressureSpot> spots;
    std::vector<Eigen::Vector3d> force_n;  ///< at the spots
  };
  Eigen::Matrix3d turn(const Patch& patch, const ElasticState& state) const;

  const PushedFinger& finger_;
  std::vector<Patch> patches_;
};

}  // namespace finsight::host
