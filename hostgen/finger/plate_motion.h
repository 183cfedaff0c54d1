// Plate motions between two known ones.
#pragma once

#include "firmware/types.h"

namespace finsight::host {

/// The part `t` (0: a, 1: b) of an even way from a to b, number by number.
inline PlateMotion on_the_way(const PlateMotion& a, const PlateMotion& b, float t) {
  return {a.displacement_mm + t * (b.displacement_mm - a.displacement_mm),
          a.rotation_rad + t * (b.rotation_rad - a.rotation_rad)};
}

}  // namespace finsight::host
