// Where camera and markers of one device really are; `hostgen mount` measures it.
#pragma once

#include <array>
#include <string>

#include "firmware/model/model.h"
#include "firmware/settings/toml_table.h"

namespace finsight {

/// Poses in the finger frame while nothing touches the finger, as in MountModel.
struct MeasuredMount {
  Eigen::Isometry3d T_finger_camera = Eigen::Isometry3d::Identity();
  std::array<Eigen::Isometry3d, kPlates> T_finger_marker;  ///< top, middle, low
  std::string where;                                       ///< where it was read, for messages
};

/// Tables [camera] and [top], [middle], [low], each with position_mm and turn_deg: the rotation vector by which the
/// finger's axes become those of camera or marker. Strict: throws InputError like TomlTable.
MeasuredMount read_measured_mount(TomlTable table);
/// The text that read_measured_mount() reads; to 0.1 micrometres and 0.0001 degrees. `parent` precedes the tables'
/// names: "mount." for [mount.camera].
std::string measured_mount_toml(const MeasuredMount& mount, const std::string& parent = "");

/// The poses of a mount, to be written or compared.
MeasuredMount poses_of(const MountModel& mount);
/// The same poses within a micrometre and a thousandth of a degree: more than rounding changes when one is written.
bool is_same_mount(const MeasuredMount& a, const MeasuredMount& b);

/// How far from the model a measured pose may lie. Beyond that it is the mount of another finger, or was measured in a
/// bad session.
inline constexpr double kLargestMountShift_mm = 10, kLargestMountTurn_deg = 15;

/// The model's mount with the measured poses. Throws InputError where they are too far from the model's.
MountModel corrected_mount(const MountModel& model, const MeasuredMount& measured);

}  // namespace finsight
