// Where on its plate each marker sits, and how large the markers are, from how they stand when nothing touches the
// finger.
#pragma once

#include <array>
#include <optional>

#include "firmware/model/model.h"

namespace finsight {

/// Markers are stuck on by hand. A zero takes their offset out of the plates' motion, except that a marker beside its
/// place shows the motion of that place: turned by R, it moves by (R - 1) times its offset more than the plate's own.
/// Markers that a printer made smaller seem further away, and their motions larger, by as much.
class MarkerPlaces {
 public:
  /// `measured`: this device's mount where it was measured, which shows what a zero shows.
  MarkerPlaces(const MountModel& nominal, const std::optional<MountModel>& measured, const TouchModel& tolerances);

  /// The most probable offsets and size: what the zero shows is one motion of the camera against the finger (standard
  /// deviations 1 mm and 1.5 degrees), a print that is too large or small (1 %), and, besides, the markers' own offsets
  /// by the pack's tolerance.
  void estimate(const ZeroPose& zero);
  void forget();

  /// Makes motions that markers show, relative to the zero, those of the plates.
  void correct(PlatePoses& poses) const;
  const std::array<Vec3f, kPlates>& offset_mm() const { return offset_mm_; }
  float print_scale() const { return print_scale_; }  ///< of all markers, over their nominal size

 private:
  const MountModel& nominal_;
  const TouchModel& tolerances_;
  std::optional<ZeroPose> by_mount_;  ///< the zero that the nominal mount would have shown
  std::array<Vec3f, kPlates> offset_mm_;
  float print_scale_ = 1;
};

}  // namespace finsight
