#include "hostgen/hard_cases/hard_motions.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "firmware/geometry/plate_motion.h"
#include "hostgen/hard_cases/motions.h"

namespace finsight::host {

namespace {

float& number_of(PlatePoses& poses, int number) {
  PlateMotion& plate = poses.plates[static_cast<std::size_t>(number / 6)];
  return number % 6 < 3 ? plate.displacement_mm[number % 6] : plate.rotation_rad[number % 6 - 3];
}

}  // namespace

HardMotion::HardMotion(const MountModel& mount) : mount_(mount) { frames.push_back(poses({})); }

PlatePoses HardMotion::poses(const Bend& bend) const {
  return bent_plates(mount_, bend.bend_mm, bend.sideways_mm, bend.twist_deg * std::numbers::pi / 180);
}

HardMotion& HardMotion::bend(const Bend& to, double speed) {
  const Bend from = bend_;
  const double length = std::max({std::abs(to.bend_mm - from.bend_mm), std::abs(to.sideways_mm - from.sideways_mm),
                                  std::abs(to.twist_deg - from.twist_deg) * 25 / 37});
  const int count = std::max(1, static_cast<int>(std::ceil(length * 60 / 25 / speed)));
  for (int k = 1; k <= count; ++k) {
    const double t = static_cast<double>(k) / count, eased = t * t * (3 - 2 * t);
    const auto between = [&](double a, double b) { return a + eased * (b - a); };
    frames.push_back(poses({between(from.bend_mm, to.bend_mm), between(from.sideways_mm, to.sideways_mm),
                            between(from.twist_deg, to.twist_deg)}));
  }
  bend_ = to;
  return *this;
}

HardMotion& HardMotion::go(const PlatePoses& to, int count) {
  const PlatePoses from = frames.back();
  for (int k = 1; k <= count; ++k) {
    const float t = static_cast<float>(k) / static_cast<float>(count);
    PlatePoses& poses = frames.emplace_back(to);
    for (std::size_t p = 0; p < kPlates && k < count; ++p) {
      poses.plates[p] = lerp(from.plates[p], to.plates[p], t);
    }
  }
  return *this;
}

HardMotion& HardMotion::hold(int count) {
  const PlatePoses last = frames.back();
  frames.insert(frames.end(), static_cast<std::size_t>(count), last);
  return *this;
}

HardMotion& HardMotion::lose(const std::vector<Plate>& plates, int first, int count) {
  for (int k = first; k < std::min(first + count, static_cast<int>(frames.size())); ++k) {
    PlatePoses& poses = frames[static_cast<std::size_t>(k)];
    for (const Plate plate : plates) {
      poses.plates[plate] = frames[static_cast<std::size_t>(k - 1)].plates[plate];
      poses.seen[plate] = false;
    }
    if (poses.seen_count() == 0) poses.quality = Quality::kInvalid;
  }
  return *this;
}

HardMotion& HardMotion::noise(double size, int first, int count) {
  constexpr double kDegree = std::numbers::pi / 180;
  constexpr double kLateral_mm = 0.02, kDepth_mm = 0.15, kTilt = 0.6 * kDegree, kRoll = 0.1 * kDegree;
  constexpr double kSigma[6] = {kLateral_mm, kDepth_mm, kLateral_mm, kTilt, kRoll, kTilt};  // the camera looks along y
  Random random(1);
  const int end = first + std::min(count, static_cast<int>(frames.size()) - first);
  for (int k = first; k < end; ++k)
    for (int i = 0; i < kPoseDims; ++i)
      number_of(frames[static_cast<std::size_t>(k)], i) += static_cast<float>(size * kSigma[i % 6] * random.normal());
  return *this;
}

HardMotion& HardMotion::spoil(int number, float value) {
  const PlatePoses last = frames.back();
  number_of(frames.emplace_back(last), number) = value;
  frames.push_back(last);
  return *this;
}

}  // namespace finsight::host
