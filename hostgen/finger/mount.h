// The part of a finger spec that says where markers and camera are, as the firmware wants it.
#pragma once

#include "firmware/model/model.h"
#include "hostgen/finger/spec.h"

namespace finsight::host {

inline MountModel mount_of(const FingerSpec& spec) {
  MountModel mount;
  for (std::size_t p = 0; p < kPlates; ++p) {
    mount.T_finger_marker[p] = spec.plates[p].T_finger_marker.cast<float>();
    mount.marker_id[p] = spec.plates[p].marker_id;
  }
  mount.T_finger_camera = spec.T_finger_camera.cast<float>();
  mount.marker_size_mm = static_cast<float>(spec.marker_size_mm);
  return mount;
}

}  // namespace finsight::host
