// How many errors the radius holds differs between kinds of touch that the plates hardly tell apart: rubbing or not, on
// a point or a patch. A small network evens that out.
#pragma once

#include <cmath>

#include "firmware/model/model.h"

namespace finsight {

// Through double, whose last-digit differences between C libraries vanish in the rounding to float.
inline float exp_float(float x) { return static_cast<float>(std::exp(static_cast<double>(x))); }
inline float log_float(float x) { return static_cast<float>(std::log(static_cast<double>(x))); }

/// Features count as at most so many standard deviations from their mean.
inline constexpr float kFarthestFeature = 3;

using RadiusFeatures = std::array<float, TouchModel::kRadiusFeatures>;

/// Of a touch with this radius (positive): where it is, how far the plates moved, how sure it is that a touch of the
/// scene moved them, what force rubs across and along as a part of the normal one, and the radius.
RadiusFeatures radius_features(const Touch& touch, float log_odds, float radius_mm);

/// What the radius is to be multiplied by: the answer of TouchModel's radius network. Features far from all that it was
/// fitted to count as those at the edge.
float radius_factor(const TouchModel& model, const RadiusFeatures& features);

}  // namespace finsight
