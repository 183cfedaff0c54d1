// An option against noise: plate motions that follow the measured ones with a known delay.
#pragma once

#include <cstdint>

#include "firmware/types.h"

namespace finsight {

/// First-order low-pass: a steady move comes out `delay_ms` late, white noise with its variance times dt / (2
/// delay_ms).
class PoseFilter {
 public:
  /// 0: poses pass unchanged.
  explicit PoseFilter(double delay_ms) : delay_ns_(delay_ms * 1e6) {}
  /// Only fresh poses take part. A gap, or plates that are seen no longer or again, start over with what is measured.
  void apply(PlatePoses& poses, std::int64_t exposure_ns);
  /// What was measured so far was measured from another zero.
  void reset() { last_.quality = Quality::kInvalid; }

 private:
  double delay_ns_;
  PlatePoses last_;
  std::int64_t last_ns_ = 0;
  double noise_share_ = 1;  ///< of the measurement's standard deviation that is left
};

}  // namespace finsight
