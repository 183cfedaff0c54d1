// A finger in closed form for tests: a clamped beam with a dimple under the touch. Not accurate physics, but
// smooth, slightly nonlinear, and with plate motions that determine the touch.
#pragma once

#include <cmath>

#include "hostgen/fem/dataset.h"

namespace finsight::test {

inline constexpr double kPlateHeights_mm[kPlates] = {92, 66, 38};

/// How far a beam clamped at 0 bends at height `at` under a unit load at height `load` (up to a constant).
inline double beam(double at, double load) {
  return at <= load ? at * at * (3 * load - at) : load * load * (3 * at - load);
}

inline host::FemState synthetic_state(double x_mm, double y_mm, double force_n) {
  host::FemState state;
  state.force_n = static_cast<float>(force_n);
  state.point_mm = Eigen::Vector3d(x_mm, y_mm, -28.4 + 0.222 * y_mm).cast<float>();
  const double stiffness = 1.4e-6 * force_n / (1 + 0.03 * force_n);
  for (std::size_t p = 0; p < kPlates; ++p) {
    const double height = kPlateHeights_mm[p];
    const double dimple = std::exp(-std::pow((height - y_mm) / 18, 2));
    const double bend = stiffness * beam(height, y_mm) + 0.25 * force_n * dimple;
    const double slope = (beam(height + 0.5, y_mm) - beam(height - 0.5, y_mm)) * stiffness;
    const double twist = -0.0011 * force_n * x_mm * std::min(1.0, height / y_mm) / (1 + 0.02 * force_n);
    state.plates[p].displacement_mm = Eigen::Vector3d(-0.02 * twist * height, -0.6 * slope * bend, bend).cast<float>();
    state.plates[p].rotation_rad = Eigen::Vector3d(slope, twist, 0.0006 * force_n * x_mm * dimple).cast<float>();
  }
  const double push_mm = stiffness * beam(y_mm, y_mm) + 0.6 * force_n;
  state.contact_mm = state.point_mm + Eigen::Vector3d(0, -0.002 * push_mm * push_mm, push_mm).cast<float>();
  state.force_vector_n = Vec3f(state.force_n, 0, 0);
  state.moment_nmm = state.contact_mm.cross(Vec3f(0, -0.217F, 0.976F) * state.force_n);
  return state;
}

inline host::FingerSpec synthetic_spec() {
  host::FingerSpec spec;
  spec.half_width = {30, -0.11};
  spec.touch_y_mm = {13, 107};
  spec.touch_edge_mm = 2;
  spec.force_n = {1, 6};
  spec.threshold_mm = 2;
  for (host::PoseNoise& noise : spec.noise) noise = {0.03, 0.15, 0.008, 0.002};
  spec.marker_size_mm = 8;
  spec.scenes = host::common_scenes();
  spec.T_finger_camera.linear() << 1, 0, 0, 0, 0, 1, 0, -1, 0;  // looks up from below the base
  spec.T_finger_camera.translation() << 0, -22, 0;
  for (std::size_t p = 0; p < kPlates; ++p) {
    Eigen::Isometry3d& T_finger_marker = spec.plates[p].T_finger_marker;
    T_finger_marker.setIdentity();
    T_finger_marker.linear() << 1, 0, 0, 0, 0, -1, 0, 1, 0;
    T_finger_marker.translation() << 13.0 * (p == 1) - 16.0 * (p == 2), kPlateHeights_mm[p], 0;
  }
  spec.cameras[0].fx = 736;
  spec.cameras[1].fx = 457;
  return spec;
}

/// `rows` x 6 contact points over the face, `forces` from 1 to 6 N at each.
inline host::FemDataset synthetic_dataset(int rows = 10, int forces = 5) {
  const host::FingerSpec spec = synthetic_spec();
  host::FemDataset dataset;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < 6; ++column) {
      const double y_mm = spec.touch_y_mm[0] + (spec.touch_y_mm[1] - spec.touch_y_mm[0]) * row / (rows - 1);
      const double half_mm = spec.half_width.at(y_mm) - spec.touch_edge_mm;
      for (int k = 0; k < forces; ++k) {
        dataset.states.push_back(synthetic_state(half_mm * (2.0 * column / 5 - 1), y_mm, 1 + 5.0 * k / (forces - 1)));
        dataset.states.back().path = row * 6 + column;
      }
    }
  }
  return dataset;
}

}  // namespace finsight::test
