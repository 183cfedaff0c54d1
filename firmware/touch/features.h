// What the touch network looks at: which way the plates moved, how far, and which of them were seen.
#pragma once

#include "firmware/model/plate_prior.h"

namespace finsight {

/// Added to the size of a motion (in scaled mm) before its logarithm is taken, so that rest has one.
inline constexpr float kSmallestMotion = 1e-3f;

/// The network's normalised inputs [TouchModel::kInputs]. The direction of the 18 scaled numbers tells where the finger
/// is touched almost independently of the force; the logarithm of their size tells the force; the flags tell how much
/// of the direction was measured. Training and firmware both call this function.
void touch_features(const TouchModel& model, const PlateNumbers& numbers, const std::array<bool, kPlates>& seen,
                    std::span<float, TouchModel::kInputs> inputs);

}  // namespace finsight
