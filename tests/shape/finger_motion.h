// Plate motions of a bending and twisting finger, for the tests of the shape solver.
#pragma once

#include <algorithm>
#include <cmath>

#include "firmware/geometry/so3.h"
#include "firmware/model/model.h"
#include "hostgen/finger/mesh.h"

namespace finsight::test {

/// Markers in the middle of the plates' nodes.
inline MountModel mount_of(const host::TetMesh& mesh) {
  MountModel mount;
  for (int p = 0; p < kPlates; ++p) {
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    for (const int node : mesh.plate_nodes[p]) centre += Eigen::Map<const Eigen::Vector3d>(mesh.node_mm[node].data());
    mount.T_finger_marker[p] =
        Eigen::Translation3f((centre / static_cast<double>(mesh.plate_nodes[p].size())).cast<float>());
  }
  return mount;
}

/// A finger clamped at its base and pushed at its tip.
struct Bend {
  double deep_mm = 0, across_mm = 0, twist_deg = 0;  // of the tip

  PlatePoses poses(const MountModel& mount, double part = 1) const {
    constexpr double kLength = 110;
    PlatePoses poses;
    poses.quality = Quality::kFresh;
    poses.seen = {true, true, true};
    const double dz = part * deep_mm, dx = part * across_mm;
    for (int p = 0; p < kPlates; ++p) {
      const Eigen::Vector3d centre = mount.T_finger_marker[p].translation().cast<double>();
      const double y = centre.y() / kLength;
      const Eigen::AngleAxisd twist(part * twist_deg * M_PI / 180 * y, Eigen::Vector3d::UnitY());
      const Eigen::AngleAxisd rotation(twist * Eigen::AngleAxisd(2 * dz * y / kLength, Eigen::Vector3d::UnitX()) *
                                       Eigen::AngleAxisd(-2 * dx * y / kLength, Eigen::Vector3d::UnitZ()));
      const Eigen::Vector3d from_axis = centre - Eigen::Vector3d(0, centre.y(), 0);
      const Eigen::Vector3d shift =
          twist * from_axis - from_axis +
          Eigen::Vector3d(dx * y * y, -0.6 * (dz * dz + dx * dx) * y * y * y / kLength, dz * y * y);
      poses.plates[p].displacement_mm = shift.cast<float>();
      poses.plates[p].rotation_rad = so3_log(rotation.toRotationMatrix()).cast<float>();
    }
    return poses;
  }

  /// Frames from rest to the full bend at 60 frames/s: 25 mm/s or 37 deg/s, speeding up and slowing down.
  int frames() const {
    return static_cast<int>(
        std::ceil(12 * std::max({std::abs(deep_mm) / 5, std::abs(across_mm) / 5, std::abs(twist_deg) / 7.5})));
  }
  PlatePoses frame(const MountModel& mount, int frame) const {
    const double t = std::min(1.0, static_cast<double>(frame) / frames());
    return poses(mount, t * t * (3 - 2 * t));
  }
};

}  // namespace finsight::test
