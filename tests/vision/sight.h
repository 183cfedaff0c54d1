// Lines of sight from a camera to the markers' corners of moved plates, without an image.
#pragma once

#include "firmware/geometry/so3.h"
#include "firmware/vision/plate_estimator.h"
#include "tests/vision/test_finger.h"

namespace finsight::test {

/// Of test_mount()'s plates; every ray is off by `scatter_px` at a focal length of `focal_px`.
inline PlateSight sight_of(const std::array<PlateMotion, kPlates>& plates, double focal_px, double scatter_px,
                           Random& random) {
  const MountModel mount = test_mount();
  PlateSight sight;
  sight.seen = {true, true, true};
  sight.corner_sigma_px = scatter_px;
  for (std::size_t p = 0; p < kPlates; ++p) {
    const Eigen::Isometry3d T_finger_marker = mount.T_finger_marker[p].cast<double>();
    const Eigen::Matrix3d R = so3_exp(plates[p].rotation_rad.cast<double>());
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d corner = R * (T_finger_marker.linear() * marker_corner(mount.marker_size_mm, k)) +
                                     T_finger_marker.translation() + plates[p].displacement_mm.cast<double>();
      const Eigen::Vector3d seen = mount.T_finger_camera.cast<double>().inverse() * corner;
      sight.rays[p][k] =
          seen.head<2>() / seen.z() + scatter_px / focal_px * Eigen::Vector2d(random.normal(), random.normal());
    }
  }
  return sight;
}

/// The plates as a displaced camera sees them: all moved by (t, w) about the finger's origin.
inline std::array<PlateMotion, kPlates> moved_as_one(const Eigen::Vector3d& t_mm, const Eigen::Vector3d& w_rad) {
  std::array<PlateMotion, kPlates> plates;
  const Eigen::Matrix3d R = so3_exp(w_rad);
  for (std::size_t p = 0; p < kPlates; ++p) {
    const Eigen::Vector3d centre = test_mount().T_finger_marker[p].translation().cast<double>();
    plates[p] = {(R * centre + t_mm - centre).cast<float>(), w_rad.cast<float>()};
  }
  return plates;
}

}  // namespace finsight::test
