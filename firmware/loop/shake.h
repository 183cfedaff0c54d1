// How hard the plates are shaken: an accelerated finger is also bent by its own mass.
#pragma once

#include <cstdint>

#include "firmware/types.h"

namespace finsight {

class Shake {
 public:
  /// Of the second difference of a plate's position over three frames, x[k] - 2 x[k-1] + x[k-2]. Touches stay below
  /// 0.3 mm at 60 frames/s, noise included; shaking by 3 mm at 12 Hz makes 4 mm.
  static constexpr float kMin_mm = 0.5F;
  static constexpr std::uint32_t kLastingFrames = 30;  ///< a shake is over after this many frames without one

  /// The largest second difference (mm) of any seen plate in the last frames, 0 below kMin_mm. In frames, not in
  /// seconds: a replay at full speed says the same. Frames without measured poses change nothing. Never allocates.
  float update(const PlatePoses& poses, std::uint32_t sequence);
  /// Forgets what was measured from another zero.
  void reset() { *this = Shake(); }

 private:
  struct Sample {
    PlatePoses poses;
    std::uint32_t sequence = 0;
  };
  std::array<Sample, 2> last_;  // the last one first
  float largest_mm_ = 0;
  std::uint32_t largest_sequence_ = 0;
};

}  // namespace finsight
