#include "hostgen/fit/pack_error.h"

#include <cmath>

namespace finsight::host {

PackError pack_error(const PressedPlace& place, double force_n, const Vec3f& hole_mm, TouchStage& stage) {
  if (!(force_n > 0)) return {};
  PlatePoses poses{.plates = place.plates(force_n), .quality = Quality::kFresh};
  poses.seen.fill(true);
  const Touch touch = stage.locate(poses);
  if (touch.quality != Quality::kFresh || !(touch.force_n > 0)) return {};
  return {touch.point_mm - hole_mm, std::log(force_n / static_cast<double>(touch.force_n))};
}

}  // namespace finsight::host
