// Optional noise reduction: a low-pass on the plate motions with a known delay.
#pragma once

#include <cstdint>

#include "firmware/types.h"

namespace finsight {

/// First-order low-pass: a steady move comes out `delay_ms` late, and the variance of white noise is multiplied by
/// dt / (2 delay_ms). What the poses say of their noise stays that of a single frame: no finger is exactly the one that
/// the touch network learnt, and told of less noise the network takes the difference for a touch.
class PoseFilter {
 public:
  /// 0: poses pass unchanged.
  explicit PoseFilter(double delay_ms) : delay_ns_(delay_ms * 1e6) {}
  /// Only fresh poses take part. The filter starts over after a gap and when plates disappear
  /// or reappear.
  void apply(PlatePoses& poses, std::int64_t exposure_ns);
  /// Forgets what was measured from another zero.
  void reset() { last_.quality = Quality::kInvalid; }

 private:
  double delay_ns_;
  PlatePoses last_;
  std::int64_t last_ns_ = 0;
};

}  // namespace finsight
