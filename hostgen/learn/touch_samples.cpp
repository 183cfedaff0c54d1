#include "hostgen/learn/touch_samples.h"

#include <algorithm>
#include <cmath>

#include "firmware/touch/features.h"

namespace finsight::host {

namespace {

constexpr float kMaxTrainedNoise = 4;

}  // namespace

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

void add_noise(const std::array<PoseNoise, kPlates>& noise, Random& random, PoseVector& numbers,
               const std::array<float, kPlates>& size) {
  for (std::size_t p = 0; p < kPlates; ++p) {
    const auto sigmas = noise[p].standard_deviations();
    for (std::size_t i = 0; i < 6; ++i) {
      numbers[static_cast<int>(6 * p + i)] += size[p] * static_cast<float>(sigmas[i] * random.normal());
    }
  }
}

void turn(const GravityCorrection& gravity, double felt_g, Random& random, PoseVector& numbers) {
  const Vec3f at_zero_g = random_direction(random).cast<float>();
  const Vec3f now_g = (felt_g * random_direction(random)).cast<float>();
  numbers += gravity.bend(numbers, now_g) - gravity.bend(PoseVector::Zero(), at_zero_g);
}

float add_gravity(const GravityCorrection& gravity, Random& random, PoseVector& numbers) {
  constexpr double kUnknownShare = 0.2, kKnownShare = 0.1;  // the others have not turned
  constexpr double kStrongest_g = 3, kLeftOver_g[] = {0.02, 0.5};
  const double draw = random.uniform();
  if (draw < kUnknownShare) {
    turn(gravity, random.uniform() < 0.5 ? 1 : random.uniform(0, kStrongest_g), random, numbers);
    return GravityCorrection::kUnknown_g;
  }
  if (draw >= kUnknownShare + kKnownShare) return 0;
  const double left_g = std::exp(random.uniform(std::log(kLeftOver_g[0]), std::log(kLeftOver_g[1])));
  Vec3f g;
  for (float& component : g) component = static_cast<float>(left_g * random.normal());
  numbers += gravity.bend(numbers, g);
  return static_cast<float>(left_g);
}

// The deflection a (h / top)^2 turns a plate by its slope, 2 a h / top^2: towards +z about x, towards +x about -z.
void deflect(const std::array<double, kPlates>& plate_height_mm, double x_mm, double z_mm, PoseVector& numbers) {
  const double top_mm = plate_height_mm[kTopPlate];
  for (int p = 0; p < kPlates; ++p) {
    const double share = plate_height_mm[static_cast<std::size_t>(p)] / top_mm;
    numbers[6 * p] += static_cast<float>(x_mm * share * share);
    numbers[6 * p + 2] += static_cast<float>(z_mm * share * share);
    numbers[6 * p + 3] += static_cast<float>(2 * z_mm * share / top_mm);
    numbers[6 * p + 5] -= static_cast<float>(2 * x_mm * share / top_mm);
  }
}

float add_swing(const std::array<double, kPlates>& plate_height_mm, Random& random, PoseVector& numbers) {
  constexpr double kShare = 0.05, kSwing_mm = 2;
  if (plate_height_mm[kTopPlate] == plate_height_mm[kLowPlate] || random.uniform() >= kShare) return 0;
  const double x_mm = kSwing_mm * random.normal(), z_mm = kSwing_mm * random.normal();
  deflect(plate_height_mm, x_mm, z_mm, numbers);
  return static_cast<float>(std::hypot(x_mm, z_mm));
}

void loosen_plate(Random& random, PoseVector& numbers) {
  constexpr double kAway_mm = 2, kAway_rad = 0.1;
  const auto first = static_cast<int>(6 * random.index(kPlates));
  for (int i = 0; i < 6; ++i) {
    numbers[first + i] = static_cast<float>((i < 3 ? kAway_mm : kAway_rad) * random.normal());
  }
}

std::array<float, kPlates> draw_noise(Random& random) {
  constexpr double kPlateSpread = 0.3;
  const double common = random.uniform(std::log(kMinNoise), std::log(kMaxTrainedNoise));
  std::array<float, kPlates> size;
  for (float& plate : size) {
    plate = std::clamp(static_cast<float>(std::exp(common + kPlateSpread * random.normal())), kMinNoise, kMaxNoise);
  }
  return size;
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
