// The touches that the network is trained on: drawn between the computed states, measured badly, plates missing.
#pragma once

#include <array>
#include <vector>

#include "hostgen/learn/state_interpolant.h"
#include "hostgen/util/random.h"

namespace finsight::host {

/// `count` touches spread evenly over the touchable face of the spec and over forces from 0 to the highest computed.
std::vector<TouchSample> draw_touches(const FingerSpec& spec, const StateInterpolant& states, std::size_t count,
                                      Random& random);

/// Adds what the camera gets wrong: `size` times the spec's noise.
void add_noise(const std::array<PoseNoise, kPlates>& noise, Random& random, PoseVector& numbers,
               const std::array<float, kPlates>& size = {1, 1, 1});

/// Mostly nothing; for one touch in twenty what inertia adds when the hand is shaken: a beam's swing to any side, up to
/// some millimetres at the top plate, which goes by the square of the height. `plate_height_mm`: of the plates'
/// markers; the same for all three means no swing.
void add_swing(const std::array<double, kPlates>& plate_height_mm, Random& random, PoseVector& numbers);

/// How well a finger's plates are measured: from a tenth of the spec's noise (hardly any) to four times it, evenly in
/// its logarithm, much the same for all three.
std::array<float, kPlates> draw_noise(Random& random);

/// Which plates are seen: mostly all, sometimes two, seldom one.
std::array<bool, kPlates> draw_seen(Random& random);

}  // namespace finsight::host
