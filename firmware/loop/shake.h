// How hard the plates are shaken: a finger whose plates accelerate is bent by its own mass, too.
#pragma once

#include <cstdint>

#include "firmware/types.h"

namespace finsight {

class Shake {
 public:
  /// Of a plate's place over three frames (place - 2 place before + place before that). Touches stay below 0.3 mm at
  /// 60 frames/s, noise included; a hand that jerks by 3 mm, twelve times a second, makes 4.
  static constexpr float kMin_mm = 0.5F;
  static constexpr std::uint32_t kLastingFrames = 30;  ///< a shake is over when none was seen for so long

  /// The largest second difference (mm) of any seen plate in the last frames, 0 below kMin_mm. In frames, not in
  /// seconds: a replay at full speed says the same. Frames without measured poses change nothing. Never allocates.
  float update(const PlatePoses& poses, std::uint32_t sequence);
  /// What was seen so far was seen from another zero.
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
