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

std::string pose_toml(const std::string& name, const Eigen::Isometry3d& pose) {
  const Vector3d p = pose.translation(), w = kDegPerRad * so3_log(pose.linear());
  char text[256];
  std::snprintf(text, sizeof text, "[%s]\nposition_mm = [%.4f, %.4f, %.4f]\nturn_deg = [%.4f, %.4f, %.4f]\n",
                name.c_str(), p.x(), p.y(), p.z(), w.x(), w.y(), w.z());
  return text;
}

struct Distance {
  double shift_mm, turn_deg;
};

Distance distance_between(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  const Eigen::Isometry3d off = a.inverse() * b;
  return {off.translation().norm(), so3_log(off.linear()).norm() * kDegPerRad};
}

/// `measured`, if it is near enough to `model`; throws InputError otherwise.
Eigen::Isometry3f checked(const char* name, const Eigen::Isometry3f& model, const Eigen::Isometry3d& measured,
                          const std::string& where) {
  const Distance distance = distance_between(model.cast<double>(), measured);
  const auto require = [&](double found, double largest, const char* unit) {
    if (found <= largest) return;
    throw InputError(where, name, std::to_string(found) + unit + " from where the model has it",
                     "at most " + std::to_string(largest) + unit + "; is it the mount of another finger?");
  };
  require(distance.shift_mm, kLargestMountShift_mm, " mm");
  require(distance.turn_deg, kLargestMountTurn_deg, " deg");
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

std::string measured_mount_toml(const MeasuredMount& mount, const std::string& parent) {
  std::string text = pose_toml(parent + "camera", mount.T_finger_camera);
  for (std::size_t p = 0; p < kPlates; ++p) text += pose_toml(parent + kPlateNames[p], mount.T_finger_marker[p]);
  return text;
}

MeasuredMount poses_of(const MountModel& mount) {
  MeasuredMount poses;
  poses.T_finger_camera = mount.T_finger_camera.cast<double>();
  for (std::size_t p = 0; p < kPlates; ++p) poses.T_finger_marker[p] = mount.T_finger_marker[p].cast<double>();
  return poses;
}

bool is_same_mount(const MeasuredMount& a, const MeasuredMount& b) {
  const auto is_same = [](const Eigen::Isometry3d& x, const Eigen::Isometry3d& y) {
    const Distance distance = distance_between(x, y);
    return distance.shift_mm <= 0.001 && distance.turn_deg <= 0.001;
  };
  bool same = is_same(a.T_finger_camera, b.T_finger_camera);
  for (std::size_t p = 0; p < kPlates; ++p) same = same && is_same(a.T_finger_marker[p], b.T_finger_marker[p]);
  return same;
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
