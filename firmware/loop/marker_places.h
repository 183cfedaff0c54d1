// Where on its plate each marker sits, from how the markers stand when nothing touches the finger.
#pragma once

#include <array>

#include "firmware/model/model.h"

namespace finsight {

/// Markers are stuck on by hand. A zero takes their offset out of the plates' motion, except that a marker beside its
/// place shows the motion of that place: turned by R, it moves by (R - 1) times its offset more than the plate's own.
class MarkerPlaces {
 public:
  MarkerPlaces(const MountModel& mount, const TouchModel& tolerances) : mount_(mount), tolerances_(tolerances) {}

  /// The most probable offsets: what the zero shows is one motion of the camera against the finger (standard
  /// deviations 1 mm and 1.5 degrees) and, besides, the markers' own by the pack's tolerance.
  void estimate(const ZeroPose& zero);
  void forget() { offset_mm_.fill(Vec3f::Zero()); }

  /// Makes motions that markers show, relative to the zero, those of the plates.
  void correct(PlatePoses& poses) const;
  const std::array<Vec3f, kPlates>& offset_mm() const { return offset_mm_; }

 private:
  const MountModel& mount_;
  const TouchModel& tolerances_;
  std::array<Vec3f, kPlates> offset_mm_ = {Vec3f::Zero(), Vec3f::Zero(), Vec3f::Zero()};
};

}  // namespace finsight
