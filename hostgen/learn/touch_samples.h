// The touches that the network is trained on: drawn between the computed states, measured badly, plates missing.
#pragma once

#include <array>
#include <vector>

#include "hostgen/learn/state_interpolant.h"
#include "hostgen/random.h"

namespace finsight::host {

/// `count` touches spread evenly over the touchable face of the spec and over forces from 0 to the highest computed.
std::vector<TouchSample> draw_touches(const FingerSpec& spec, const StateInterpolant& states, std::size_t count,
                                      Random& random);

/// Adds what the camera gets wrong. It looks along the finger's y axis: y is depth, x and z are lateral, rotations
/// about x and z are tilt, about y roll.
void add_noise(const std::array<PoseNoise, kPlates>& noise, Random& random, PlateNumbers& numbers);

/// Which plates are seen: mostly all, sometimes two, seldom one.
std::array<bool, kPlates> draw_seen(Random& random);

}  // namespace finsight::host
