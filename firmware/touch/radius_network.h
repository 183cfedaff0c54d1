// How many errors the radius holds differs between kinds of touch that the plates hardly tell apart: rubbing or not, on
// a point or a patch. A small network evens that out.
#pragma once

#include "firmware/model/model.h"

namespace finsight {

using RadiusFeatures = std::array<float, TouchModel::kRadiusFeatures>;

/// Of a touch with this radius (positive): where it is, how far the plates moved, how sure it is that a touch of the
/// scene moved them, what force rubs across and along as a part of the normal one, the radius, and what the network
/// says of the force's deviations (positive; a finger's stiffness not counted), and how much gravity is unknown.
RadiusFeatures radius_features(const Touch& touch, float log_odds, float radius_mm, float unknown_g);

/// The network's inputs: features by their means and deviations (TouchModel::radius_inputs), at most three deviations
/// away, so that what is far from all that it was fitted to counts as what is at the edge. Training and firmware both
/// call this function.
RadiusFeatures normalised(std::span<const float> radius_inputs, const RadiusFeatures& features);

/// What the radius is to be multiplied by: the answer of TouchModel's radius network.
float radius_factor(const TouchModel& model, const RadiusFeatures& features);

}  // namespace finsight
