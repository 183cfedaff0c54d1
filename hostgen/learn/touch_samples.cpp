#include "hostgen/learn/touch_samples.h"

namespace finsight::host {

std::vector<TouchSample> draw_touches(const FingerSpec& spec, const StateInterpolant& states, std::size_t count,
                                      Random& random) {
  std::vector<TouchSample> touches;
  touches.reserve(count);
  while (touches.size() < count) {
    const double y_mm = random.uniform(spec.touch_y_mm[0], spec.touch_y_mm[1]);
    const double x_mm = (spec.half_width.at(y_mm) - spec.touch_edge_mm) * random.uniform(-1.0, 1.0);
    touches.push_back(states.at(x_mm, y_mm, states.highest_force_n(x_mm, y_mm) * random.uniform()));
  }
  return touches;
}

void add_noise(const std::array<PoseNoise, kPlates>& noise, Random& random, PlateNumbers& numbers) {
  for (std::size_t p = 0; p < kPlates; ++p) {
    const double sigmas[6] = {noise[p].lateral_mm, noise[p].depth_mm, noise[p].lateral_mm,
                              noise[p].tilt_rad,   noise[p].roll_rad, noise[p].tilt_rad};
    for (std::size_t i = 0; i < 6; ++i) {
      numbers[static_cast<int>(6 * p + i)] += static_cast<float>(sigmas[i] * random.normal());
    }
  }
}

std::array<bool, kPlates> draw_seen(Random& random) {
  constexpr double kOneMissing = 0.15, kTwoMissing = 0.10;
  std::array<bool, kPlates> seen = {true, true, true};
  const double draw = random.uniform();
  const std::size_t plate = random.index(kPlates);
  if (draw < kTwoMissing) {
    seen = {plate == 0, plate == 1, plate == 2};
  } else if (draw < kTwoMissing + kOneMissing) {
    seen[plate] = false;
  }
  return seen;
}

}  // namespace finsight::host
