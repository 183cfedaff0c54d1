#include "firmware/settings/measured_mount.h"

#include <cstdio>
#include <numbers>
#include <utility>

#include "firmware/geometry/so3.h"
#include "firmware/input_error.h"

namespace finsight {

namespace {

using Eigen::Vector3d;

constexpr double kDegPerRad = 180 / std::numbers::pi;

Vector3d vector(TomlTable& table, const char* key, double largest) {
  const std::vector<double> values = table.numbers(key, 3, -largest, largest);
  return {values[0], values[1], values[2]};
}

Eigen::Isometry3d read_pose(TomlTable table) {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = so3_exp(vector(table, "turn_deg", 360) / kDegPerRad);
  pose.translation() = vector(table, "position_mm", 1000);
  table.finish();
  return pose;
}

std::string pose_toml(const char* name, const Eigen::Isometry3d& pose) {
  const Vector3d p = pose.translation(), w = kDegPerRad * so3_log(pose.linear());
  char text[256];
  std::snprintf(text, sizeof text, "[%s]\nposition_mm = [%.4f, %.4f, %.4f]\nturn_deg = [%.4f, %.4f, %.4f]\n", name,
                p.x(), p.y(), p.z(), w.x(), w.y(), w.z());
  return text;
}

/// `measured`, where it is near enough to `model`.
Eigen::Isometry3f checked(const char* name, const Eigen::Isometry3f& model, const Eigen::Isometry3d& measured,
                          const std::string& where) {
  const Eigen::Isometry3d off = model.cast<double>().inverse() * measured;
  const auto require = [&](double found, double largest, const char* unit) {
    if (found <= largest) return;
    throw InputError(where, name, std::to_string(found) + unit + " from where the model has it",
                     "at most " + std::to_string(largest) + unit + "; is it the mount of another finger?");
  };
  require(off.translation().norm(), kLargestMountShift_mm, " mm");
  require(so3_log(off.linear()).norm() * kDegPerRad, kLargestMountTurn_deg, " deg");
  return measured.cast<float>();
}

}  // namespace

MeasuredMount read_measured_mount(TomlTable table) {
  MeasuredMount mount;
  mount.where = table.where();
  mount.T_finger_camera = read_pose(table.table("camera"));
  for (std::size_t p = 0; p < kPlates; ++p) mount.T_finger_marker[p] = read_pose(table.table(kPlateNames[p]));
  table.finish();
  return mount;
}

std::string measured_mount_toml(const MeasuredMount& mount) {
  std::string text = pose_toml("camera", mount.T_finger_camera);
  for (std::size_t p = 0; p < kPlates; ++p) text += pose_toml(kPlateNames[p], mount.T_finger_marker[p]);
  return text;
}

MountModel corrected_mount(const MountModel& model, const MeasuredMount& measured) {
  MountModel mount = model;
  mount.T_finger_camera = checked("camera", model.T_finger_camera, measured.T_finger_camera, measured.where);
  for (std::size_t p = 0; p < kPlates; ++p) {
    mount.T_finger_marker[p] =
        checked(kPlateNames[p], model.T_finger_marker[p], measured.T_finger_marker[p], measured.where);
  }
  return mount;
}

}  // namespace finsight
