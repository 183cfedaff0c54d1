// Builds the sequences of plate motions of the hard cases, frame by frame at 60 frames/s.
#pragma once

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

  /// Bends on from the last bend, speeding up and slowing down, at `speed` times 25 mm/s and 37 deg/s.
  HardMotion& bend(const Bend& to, double speed = 1);
  /// Changes the 18 plate numbers evenly to those of `to` in so many frames; 1 is a jump.
  HardMotion& go(const PlatePoses& to, int frames);
  HardMotion& go(const Bend& to, int frames) { return go(poses(to), frames); }
  /// Repeats the last frame.
  HardMotion& hold(int frames);
  /// From frame `first` on, `count` frames do not see a plate: it stays where it was, or if no plate is seen the poses
  /// are invalid.
  HardMotion& lose(const std::vector<Plate>& plates, int first, int count);
  /// Adds noise to every frame: `size` times what the camera's is estimated to be.
  HardMotion& noise(double size);
  /// One frame like the last, but with this number among its 18; and one without.
  HardMotion& spoil(int number, float value);

  PlatePoses poses(const Bend& bend) const;
  std::vector<PlatePoses> frames;

 private:
  const MountModel& mount_;
  Bend bend_;
};

}  // namespace finsight::host
