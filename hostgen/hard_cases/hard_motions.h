// Builds the plate motions of the hard cases, frame by frame at 60 frames/s.
#pragma once

#include <limits>
#include <vector>

#include "firmware/model/model.h"
#include "hostgen/util/random.h"

namespace finsight::host {

struct Bend {
  double bend_mm = 0, sideways_mm = 0, twist_deg = 0;  ///< of the finger's tip, see bent_plates()
};

class HardMotion {
 public:
  explicit HardMotion(const MountModel& mount);

  /// Continues from the last bend to this one, speeding up and slowing down, at `speed` times 25 mm/s and 37 deg/s.
  HardMotion& bend(const Bend& to, double speed = 1);
  /// Changes the plate numbers linearly to those of `to` within `frames` frames; 1 is a jump.
  HardMotion& go(const PlatePoses& to, int frames);
  HardMotion& go(const Bend& to, int frames) { return go(poses(to), frames); }
  /// Repeats the last frame.
  HardMotion& hold(int frames);
  /// Hides a plate for `count` frames from `first` on: it keeps its motion; if no plate is seen the poses are invalid.
  HardMotion& lose(const std::vector<Plate>& plates, int first, int count);
  /// Adds noise to `count` frames from `first` on, to all by default: `size` times the camera's estimated noise.
  HardMotion& noise(double size, int first = 0, int count = std::numeric_limits<int>::max());
  /// Repeats the last frame with one of its plate numbers replaced, then once more without.
  HardMotion& spoil(int number, float value);

  PlatePoses poses(const Bend& bend) const;
  std::vector<PlatePoses> frames;

 private:
  const MountModel& mount_;
  Bend bend_;
};

}  // namespace finsight::host
