// What is done with plate motions.
#pragma once

#include "firmware/types.h"

namespace finsight {

/// Half a millimetre per degree, the lever of a plate's edge: makes rotations comparable with displacements.
inline constexpr float kMillimetresPerRadian = 28.65f;

/// Linear interpolation from a (t = 0) to b (t = 1), number by number.
inline PlateMotion lerp(const PlateMotion& a, const PlateMotion& b, float t) {
  return {a.displacement_mm + t * (b.displacement_mm - a.displacement_mm),
          a.rotation_rad + t * (b.rotation_rad - a.rotation_rad)};
}

}  // namespace finsight
