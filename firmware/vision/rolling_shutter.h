// Pictures whose rows are exposed one after the other.
#pragma once

#include "firmware/types.h"

namespace finsight {

/// Moves corners to where they would be if all rows had been exposed at the frame's time, which is that of the middle
/// row: along each marker's motion in the image since the frame before. A marker that has not been seen for a tenth of
/// a second stays where it is, as do all markers where all rows are exposed at once, or where two frames are nearer in
/// time than half a read-out. Never allocates.
class RollingShutter {
 public:
  /// From the first row's exposure to the last's; 0: all at once.
  explicit RollingShutter(std::int64_t readout_ns) : readout_ns_(readout_ns) {}
  bool is_rolling() const { return readout_ns_ > 0; }
  void straighten(const Frame& frame, MarkerCorners& corners);

 private:
  struct Sighting {
    Vec2f middle_px = Vec2f::Zero();
    std::int64_t seen_ns = 0;  ///< of the marker's own rows; 0: never
  };
  float after_middle_ns(const Frame& frame, float row) const;

  std::int64_t readout_ns_;
  std::array<Sighting, kPlates> last_;
};

}  // namespace finsight
