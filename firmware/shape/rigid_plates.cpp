#include "firmware/shape/rigid_plates.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "firmware/geometry/so3.h"
#include "firmware/input_error.h"

namespace finsight {

PlateMotions plate_motions(const PlatePoses& poses) {
  PlateMotions motions;
  for (int p = 0; p < kPlates; ++p) {
    motions[p].rotation = so3_exp_quaternion(poses.plates[p].rotation_rad.cast<double>());
    motions[p].displacement_mm = poses.plates[p].displacement_mm.cast<double>();
  }
  return motions;
}

PlateMotions between(const PlateMotions& a, const PlateMotions& b, double t) {
  PlateMotions motions;
  for (int p = 0; p < kPlates; ++p) {
    motions[p].rotation = a[p].rotation.slerp(t, b[p].rotation);
    motions[p].displacement_mm = (1 - t) * a[p].displacement_mm + t * b[p].displacement_mm;
  }
  return motions;
}

RigidPlates::RigidPlates(const ShapeModel& model, const MountModel& mount) {
  for (int p = 0; p < kPlates; ++p) centre_mm_[p] = mount.T_finger_marker[p].translation().cast<double>();
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  Eigen::Vector3d lowest = Eigen::Vector3d::Constant(kInfinity), highest = -lowest;
  for (int i = 0; i < model.nodes; ++i) {
    const Eigen::Vector3d rest(model.rest_mm[3 * i], model.rest_mm[3 * i + 1], model.rest_mm[3 * i + 2]);
    lowest = lowest.cwiseMin(rest);
    highest = highest.cwiseMax(rest);
    if (model.node_kind[i] >= 2)
      nodes_[model.node_kind[i] - 2].push_back({i, rest - centre_mm_[model.node_kind[i] - 2]});
  }
  extent_mm_ = (highest - lowest).norm();
  for (int p = 0; p < kPlates; ++p)
    if (nodes_[p].empty())
      throw InputError("shape model", "node_kind", "no node of plate " + std::to_string(p), "some");
}

bool RigidPlates::plausible(const PlatePoses& poses) const {
  constexpr double kMaxExtents = 3, kMaxRadians = 7;  // a rotation vector of one turn is 6.3 long
  return std::all_of(poses.plates.begin(), poses.plates.end(), [&](const PlateMotion& plate) {
    const Eigen::Vector3d displacement = plate.displacement_mm.cast<double>();
    return displacement.allFinite() && plate.rotation_rad.allFinite() &&
           displacement.norm() <= kMaxExtents * extent_mm_ && plate.rotation_rad.cast<double>().norm() <= kMaxRadians;
  });
}

double RigidPlates::furthest_mm(const PlateMotions& a, const PlateMotions& b) const {
  double furthest_sq = 0;
  for (int p = 0; p < kPlates; ++p) {
    const Eigen::Matrix3d turn = b[p].rotation.toRotationMatrix() - a[p].rotation.toRotationMatrix();
    const Eigen::Vector3d shift = b[p].displacement_mm - a[p].displacement_mm;
    for (const Node& node : nodes_[p])
      furthest_sq = std::max(furthest_sq, (turn * node.from_centre_mm + shift).squaredNorm());
  }
  return std::sqrt(furthest_sq);
}

}  // namespace finsight
