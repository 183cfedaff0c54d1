// Where camera and markers of one device really are; `hostgen mount` measures it.
#pragma once

#include <array>
#include <string>

#include "firmware/model/model.h"
#include "firmware/settings/toml_table.h"

namespace finsight {

/// Poses in the finger frame when nothing touches the finger, as in MountModel.
struct MeasuredMount {
  Eigen::Isometry3d T_finger_camera = Eigen::Isometry3d::Identity();
  std::array<Eigen::Isometry3d, kPlates> T_finger_marker;  ///< top, middle, low
  std::string where;                                       ///< it was read, for messages
};

/// Tables [camera] and [top], [middle], [low], each with position_mm and turn_deg: the rotation vector by which the
/// finger's axes become those of camera or marker. Strict: throws InputError like TomlTable.
MeasuredMount read_measured_mount(TomlTable table);
/// The text that read_measured_mount() reads; to 0.1 micrometres and 0.0001 degrees.
std::string measured_mount_toml(const MeasuredMount& mount);

/// How far from the model a measured pose may lie: more is no way of mounting, but another finger or a bad session.
inline constexpr double kLargestMountShift_mm = 10, kLargestMountTurn_deg = 15;

/// The model's mount with the measured poses. Throws InputError where they are too far from the model's.
MountModel corrected_mount(const MountModel& model, const MeasuredMount& measured);

}  // namespace finsight
