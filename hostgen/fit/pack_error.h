// How far a pack is off on the very finger that it was made for, where the jig presses. No weight may blame that on the
// finger that it hangs at.
#pragma once

#include <span>
#include <vector>

#include "firmware/model/model.h"
#include "hostgen/finger/jig_holes.h"

namespace finsight::host {

/// Of one push at one hole, without noise.
struct PackError {
  double pack_force_n = 0;         ///< what the pack says of the force
  Vec3f touch_mm = Vec3f::Zero();  ///< where it says the touch is, less where it is
  double log_force = 0;            ///< logarithm of the force over what the pack says
};

/// Per hole, by rising force: up to ten pushes, to half as much again as the spec's range, of those that have an
/// equilibrium and whose touch the pack publishes. Solves the finger of the spec by finite elements: some seconds.
std::vector<std::vector<PackError>> pack_errors(const FingerSpec& spec, const Model& model,
                                                const std::vector<JigHole>& holes);

/// Between the pushes, and that of the nearest beyond them. Zero if there are none.
PackError pack_error_at(std::span<const PackError> pushes, double pack_force_n);

}  // namespace finsight::host
