// What a client reads of one frame's touch.
#pragma once

#include "firmware/loop/frame_loop.h"

namespace finsight::host {

struct TouchReading {
  double time_s = 0;
  bool is_valid = false;
  Vec3f point_mm = Vec3f::Zero();
  double radius_mm = 0, force_n = 0, force_sigma_n = 0;
  float plate_motion_mm = 0;  ///< of the plate that moved furthest; no register
  float explained = 0;        ///< log-odds that a touch of the pack's scene moved the plates; no register
  PlatePoses poses{};         ///< no register
};
TouchReading touch_reading(const FrameLoop& loop, double time_s);

}  // namespace finsight::host
