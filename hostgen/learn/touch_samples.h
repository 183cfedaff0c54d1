// The touches that the network is trained on: drawn between the computed states, with noise and with plates missing.
#pragma once

#include <array>
#include <vector>

#include "firmware/loop/gravity.h"
#include "hostgen/learn/state_interpolant.h"
#include "hostgen/util/random.h"

namespace finsight::host {

/// `count` touches spread evenly over the touchable face of the spec and over forces from 0 to the highest computed.
std::vector<TouchSample> draw_touches(const FingerSpec& spec, const StateInterpolant& states, std::size_t count,
                                      Random& random);

/// Adds measurement noise: `size` times the spec's, per plate.
void add_noise(const std::array<PoseNoise, kPlates>& noise, Random& random, PoseVector& numbers,
               const std::array<float, kPlates>& size = {1, 1, 1});

/// Bends a finger that was zeroed in one pose, any, as it feels `felt_g` in any direction.
void turn(const GravityCorrection& gravity, double felt_g, Random& random, PoseVector& numbers);

/// Turns one finger in five, half of them with an arm that moves, and bends one in ten by what is left over where
/// gravity is known. Returns what is then unknown of gravity (Observation::unknown_g).
float add_gravity(const GravityCorrection& gravity, Random& random, PoseVector& numbers);

/// Adds to one touch in twenty the swing of a shaken finger: a beam's deflection in a random direction, growing with
/// the square of the height, up to some millimetres at the top plate. `plate_height_mm`: heights of the markers; if all
/// three are equal nothing is added. Returns the deflection of the top plate, mm.
float add_swing(const std::array<double, kPlates>& plate_height_mm, Random& random, PoseVector& numbers);

/// The deflection itself: by so much at the top plate.
void deflect(const std::array<double, kPlates>& plate_height_mm, double x_mm, double z_mm, PoseVector& numbers);

/// One plate, that came loose, stands anywhere near its rest.
void loosen_plate(Random& random, PoseVector& numbers);

/// Draws the noise of the three plates, relative to the spec's: from a tenth to four times, uniform in its logarithm,
/// similar for all three.
std::array<float, kPlates> draw_noise(Random& random);

/// Draws which plates are seen: mostly all, sometimes two, seldom one.
std::array<bool, kPlates> draw_seen(Random& random);

}  // namespace finsight::host
