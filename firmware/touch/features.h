// The touch network's inputs: in which direction and how far the plates moved, and how well each of them was measured.
#pragma once

#include <algorithm>

#include "firmware/model/plate_prior.h"
#include "firmware/touch/int8_network.h"

namespace finsight {

/// Added to the size of a motion (in scaled mm) before its logarithm is taken, so that it is finite at rest.
inline constexpr float kSmallestMotion = 1e-3f;

/// Range of noise (PlatePoses::noise) that the network was trained with, and the value that stands for an unseen plate.
inline constexpr float kMinNoise = 0.1f, kMaxNoise = 10, kUnseenNoise = 100;

/// Range of unknown accelerations (Observation::unknown_g) that the network tells apart, g; the largest also stands for
/// gravity of which nothing is known.
inline constexpr float kMinUnknown_g = 0.01F, kMaxUnknown_g = 1;

/// The network's input about the noise of a plate.
inline float network_noise(bool seen, float noise) {
  return seen ? std::clamp(noise, kMinNoise, kMaxNoise) : kUnseenNoise;
}

inline std::array<float, kPlates> network_noise(const PlatePoses& poses) {
  std::array<float, kPlates> noise;
  for (std::size_t p = 0; p < kPlates; ++p) noise[p] = network_noise(poses.seen[p], poses.noise[p]);
  return noise;
}

/// The network's input about gravity.
inline float log_unknown_g(float unknown_g) { return log_float(std::clamp(unknown_g, kMinUnknown_g, kMaxUnknown_g)); }

/// The network's normalised inputs [TouchModel::kInputs]. The direction of the scaled plate motions tells where the
/// finger is touched almost independently of the force; the logarithm of their size tells the force; those of the noise
/// and of what gravity may have done tell how far to trust it. Training and firmware both call this function.
void touch_features(const TouchModel& model, const PoseVector& motion, const std::array<float, kPlates>& noise,
                    float unknown_g, std::span<float, TouchModel::kInputs> inputs);

}  // namespace finsight
