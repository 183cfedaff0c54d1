// The three rigid plates as the shape solver sees them: which nodes they hold, and where a pose puts them.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <span>
#include <vector>

#include "firmware/model/model.h"

namespace finsight {

/// A point X of the undeformed plate goes to R (X - c) + c + displacement, with c the marker's centre at rest.
struct RigidMotion {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d displacement_mm = Eigen::Vector3d::Zero();
};
using PlateMotions = std::array<RigidMotion, kPlates>;

PlateMotions plate_motions(const PlatePoses& poses);
/// On the way from a to b: a at t = 0, b at t = 1; rotations along the shorter great circle.
PlateMotions between(const PlateMotions& a, const PlateMotions& b, double t);

class RigidPlates {
 public:
  /// Throws InputError if a plate has no nodes.
  RigidPlates(const ShapeModel& model, const MountModel& mount);

  /// Finite, and no further from rest than a few lengths of the finger and one turn.
  bool plausible(const PlatePoses& poses) const;

  /// The largest distance between where `a` and where `b` puts a node of the plates.
  double furthest_mm(const PlateMotions& a, const PlateMotions& b) const;

  /// Calls use(node, position) for every node of the plates.
  template <class Use>
  void for_each_node(const PlateMotions& motions, Use use) const {
    for (int p = 0; p < kPlates; ++p) {
      const Eigen::Matrix3d R = motions[p].rotation.toRotationMatrix();
      const Eigen::Vector3d shift = centre_mm_[p] + motions[p].displacement_mm;
      for (const Node& node : nodes_[p]) use(node.index, Eigen::Vector3d(R * node.from_centre_mm + shift));
    }
  }
  /// Puts the plates' nodes where they belong, exactly; `node_mm` holds [3 * nodes] positions.
  template <class S>
  void place(const PlateMotions& motions, std::span<S> node_mm) const {
    for_each_node(motions, [&](int node, const Eigen::Vector3d& position) {
      for (int d = 0; d < 3; ++d) node_mm[3 * node + d] = static_cast<S>(position[d]);
    });
  }

 private:
  struct Node {
    int index;
    Eigen::Vector3d from_centre_mm;
  };
  std::array<std::vector<Node>, kPlates> nodes_;
  std::array<Eigen::Vector3d, kPlates> centre_mm_;
  double extent_mm_ = 0;
};

}  // namespace finsight
