// Recordings of a finger in closed form, into which a test puts the faults that an audit must find.
#pragma once

#include "firmware/ports/session.h"
#include "hostgen/util/random.h"
#include "tests/learn/synthetic_finger.h"

namespace finsight::test {

struct RecordingFaults {
  double rotation_noise_rad = 5e-3;  ///< of the plate, from row to row
  double pen_noise_mm = 0.2;         ///< of a measured pen; 0: the touch was computed from the plate
  int repeats = 1;                   ///< how often the file repeats every row
  bool outlier = false;              ///< row 25 is 80 mm away
};

/// 4 x 4 contact points, one recording each, `pushes` pushes of 30 rows.
inline RecordedMotion synthetic_recordings(const RecordingFaults& faults, int pushes = 3) {
  host::Random random(5);
  RecordedMotion motion;
  for (int point = 0; point < 16; ++point) {
    for (int row = 0; row < 30 * pushes; ++row) {
      const double force_n = 0.02 + 2 * (1 - std::cos(2 * 3.14159265358979 * row / 30));
      const host::FemState state = synthetic_state(-16 + 10.7 * (point % 4), 15 + 30 * (point / 4), force_n);
      PlatePoses poses;
      PlateMotion& top = poses.plates[kTopPlate] = state.plates[kTopPlate];
      for (float& x : top.displacement_mm) x += static_cast<float>(0.05 * random.normal());
      for (float& angle : top.rotation_rad) angle += static_cast<float>(faults.rotation_noise_rad * random.normal());
      Vec3f pen_mm = state.contact_mm;
      if (faults.pen_noise_mm > 0) {
        for (float& x : pen_mm) x += static_cast<float>(faults.pen_noise_mm * random.normal());
      } else {
        pen_mm = state.point_mm + 0.9f * top.displacement_mm + 15.0f * top.rotation_rad;
      }
      if (faults.outlier && point == 0 && row == 25) top.displacement_mm = Vec3f(0, 0, 80);
      poses.seen[kTopPlate] = true;
      poses.quality = Quality::kFresh;
      for (int copy = 0; copy < faults.repeats; ++copy) {
        motion.poses.push_back(poses);
        motion.pen_mm.push_back(pen_mm);
        motion.recording.push_back(std::to_string(1000 + point));
        motion.surface_node.push_back(point);
        motion.line.push_back(static_cast<int>(motion.poses.size()) + 1);
      }
    }
  }
  return motion;
}

}  // namespace finsight::test
