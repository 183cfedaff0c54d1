#include "firmware/loop/hold.h"

namespace finsight {

const PlatePoses& Hold::poses(const PlatePoses& measured, std::int64_t now_ns, const RuntimeSettings& settings) {
  if (measured.quality == Quality::kFresh) {
    poses_ = measured;
    measured_ns_ = now_ns;
    is_over_ = false;
    return poses_;
  }
  if (now_ns - measured_ns_ > kNsPerMs * settings[kHoldTime]) is_over_ = true;
  if (poses_.quality == Quality::kInvalid) return poses_;
  const bool invalidates = settings[kAfterHold] == value_named("after_hold", "invalidate");
  poses_.quality = is_over_ && invalidates ? Quality::kInvalid : Quality::kHeld;
  poses_.seen = measured.seen;
  return poses_;
}

FingerShape Hold::shape(const FingerShape& solved) const {
  FingerShape shape = solved;
  if (poses_.quality == Quality::kInvalid) shape.quality = Quality::kInvalid;
  const bool is_own_answer = poses_.quality == Quality::kFresh && !shape.fallback;
  if (shape.quality != Quality::kInvalid) shape.quality = is_own_answer ? Quality::kFresh : Quality::kHeld;
  return shape;
}

const Touch& Hold::touch(const Touch& located) {
  if (poses_.quality == Quality::kFresh) {
    touch_ = located;
  } else if (poses_.quality == Quality::kInvalid) {
    touch_ = Touch{};
  } else if (touch_.quality == Quality::kFresh) {
    touch_.quality = Quality::kHeld;
  }
  return touch_;
}

}  // namespace finsight
