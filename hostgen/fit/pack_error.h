// How far a pack is off on the very finger that it was made for, where the jig presses. No weight may blame that on the
// finger that it hangs at.
#pragma once

#include "firmware/touch/touch_stage.h"
#include "hostgen/fit/pressed_place.h"

namespace finsight::host {

/// Of one push at one hole, without noise.
struct PackError {
  Vec3f touch_mm = Vec3f::Zero();  ///< where the pack says the touch is, less where it is
  double log_force = 0;            ///< logarithm of the force over what the pack says
};

/// `place` is that finger's at the hole. Zero where the pack publishes no touch under that force.
PackError pack_error(const PressedPlace& place, double force_n, const Vec3f& hole_mm, TouchStage& stage);

}  // namespace finsight::host
