// The one place that decides what is fresh, held or invalid: during short gaps (a shadow, a lost frame) the last
// measured values are repeated, marked as held; after longer ones they are invalid.
#pragma once

#include <cstdint>

#include "firmware/modbus/registers.h"
#include "firmware/types.h"

namespace finsight {

/// Called in the order of the data path, once per frame each: poses(), touch(), shape().
class Hold {
 public:
  /// What the other stages work on: the poses as measured if they are fresh; else the last fresh ones, held, and
  /// invalid once they are older than the hold time, unless the settings want them to stay held. `seen` is that of this
  /// frame. `now_ns`: the frame's exposure, or the moment when none came.
  const PlatePoses& poses(const PlatePoses& measured, std::int64_t now_ns, const RuntimeSettings& settings);

  /// The shape that was solved for these poses, with its quality: fresh if they are and it is the tier's own answer,
  /// held if either is not, invalid if there are no poses or no shape.
  FingerShape shape(const FingerShape& solved) const;

  /// What was located in this frame if the poses are fresh; else what was located when they were, touch or none.
  const Touch& touch(const Touch& located);

  /// No poses have been fresh for longer than the hold time, or ever.
  bool is_over() const { return is_over_; }

  /// Forgets what was measured from another zero.
  void reset() { *this = Hold(); }

 private:
  PlatePoses poses_;
  Touch touch_;
  std::int64_t measured_ns_ = 0;
  bool is_over_ = true;
};

}  // namespace finsight
