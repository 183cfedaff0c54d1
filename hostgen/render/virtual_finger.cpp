#include "hostgen/render/virtual_finger.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "firmware/geometry/so3.h"
#include "hostgen/finger/grid.h"

namespace finsight::host {

namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180;
constexpr double kCreepTime_s = 60;  // for which the workshop's creep is stated

double in_range(const std::array<double, 2>& range, Random& random) { return random.uniform(range[0], range[1]); }

/// Even in a ball.
Eigen::Vector3d within(double radius, Random& random) {
  Eigen::Vector3d at;
  do {
    for (double& x : at) x = random.uniform(-1, 1);
  } while (at.norm() > 1);
  return radius * at;
}

void misplace_markers(const Workshop& workshop, Random& random, FingerSpec& spec) {
  for (std::size_t p = 0; p < kPlates; ++p) {
    Eigen::Isometry3d& marker = spec.plates[p].T_finger_marker;
    marker.translation() += within(workshop.marker_mm, random);
    marker.linear() = so3_exp(Eigen::Vector3d(within(workshop.marker_deg * kRadPerDeg, random))) * marker.linear();
  }
}

void misplace_camera(const Workshop& workshop, Random& random, FingerSpec& spec) {
  spec.T_finger_camera.translation() += within(workshop.camera_mm, random);
  spec.T_finger_camera.linear() =
      so3_exp(Eigen::Vector3d(within(workshop.camera_deg * kRadPerDeg, random))) * spec.T_finger_camera.linear();
  const double zoom = 1 + random.uniform(-workshop.focal_length, workshop.focal_length);
  const Eigen::Vector3d off = within(workshop.principal_point_px / 1280, random);
  for (Lens& lens : spec.cameras) {
    lens.fx *= zoom;
    lens.fy *= zoom;
    lens.cx += off.x() * lens.width_px;
    lens.cy += off.y() * lens.width_px;
  }
}

}  // namespace

MaterialMemory::MaterialMemory(double creep, double creep_s, double hysteresis, double full_force_n)
    : creep_(creep), creep_s_(creep_s), full_force_n_(full_force_n) {
  // Half-way back from the full force every play up to a quarter of it has turned round and lags twice its width.
  double widest = 0;
  for (const double width : kPlayWidths) widest += 2 * std::min(width, 0.25);
  play_weight_ = hysteresis / widest;
}

double MaterialMemory::bends_as_n(double force_n, double after_s) {
  double elastic_n = force_n;
  for (std::size_t i = 0; i < play_n_.size(); ++i) {
    const double width_n = kPlayWidths[i] * full_force_n_;
    play_n_[i] = std::clamp(play_n_[i], force_n - width_n, force_n + width_n);
    elastic_n += play_weight_ * (play_n_[i] - force_n);
  }
  crept_n_ += (creep_ * elastic_n - crept_n_) * -std::expm1(-after_s / creep_s_);
  return elastic_n + crept_n_;
}

void remember(const VirtualFinger& finger, double frames_per_second, std::vector<TouchLoad>& loads) {
  MaterialMemory memory = finger.memory();
  for (TouchLoad& load : loads) {
    load.bends_as_n = memory.bends_as_n(finger.at_fit_temperature_n(load.force_n), 1 / frames_per_second);
  }
}

VirtualFinger draw_finger(const FingerSpec& spec, std::uint64_t number, const Workshop& workshop) {
  Random random(0x5eed'0000 + number);
  VirtualFinger finger;
  finger.number = number;
  const auto wall_mm = [&] { return random.uniform(-workshop.wall_mm, workshop.wall_mm); };
  const double front_mm = wall_mm(), back_mm = wall_mm(), side_mm = wall_mm();
  finger.spec = with_walls(spec, front_mm, back_mm, side_mm);
  finger.spec.youngs_modulus_mpa *= in_range(workshop.youngs_modulus, random);
  misplace_markers(workshop, random, finger.spec);
  misplace_camera(workshop, random, finger.spec);
  finger.creep_s = in_range(workshop.creep_s, random);
  finger.creep = in_range(workshop.creep, random) / -std::expm1(-kCreepTime_s / finger.creep_s);
  finger.hysteresis = in_range(workshop.hysteresis, random);
  finger.per_kelvin = in_range(workshop.per_kelvin, random);
  finger.kelvin = random.uniform(-workshop.kelvin, workshop.kelvin);
  return finger;
}

FingerSpec with_walls(const FingerSpec& spec, double front_mm, double back_mm, double side_mm) {
  FingerSpec other = spec;
  if (spec.surface) return other;
  other.front_wall_mm += front_mm;
  other.back_wall_mm += back_mm;
  other.side_wall_mm += side_mm;
  for (int p = 0; p < kPlates; ++p) {
    const double y_mm = plate_bottom_mm(spec, p);
    const auto depth_mm = [&](const FingerSpec& of) { return inner_back_mm(of, y_mm) - inner_front_mm(of, y_mm); };
    PlateSpec& plate = other.plates[static_cast<std::size_t>(p)];
    for (double& end : plate.deep) {
      const double at_mm = inner_front_mm(spec, y_mm) + end * depth_mm(spec);
      end = (at_mm - inner_front_mm(other, y_mm)) / depth_mm(other);
    }
    // A plate that hangs on a side wall goes along with it.
    const double half_mm = inner_half_width_mm(other, y_mm), wider = inner_half_width_mm(spec, y_mm) / half_mm;
    const double along = plate.across[1] == 1 ? 1 - wider : plate.across[0] == -1 ? wider - 1 : 0;
    for (double& end : plate.across) {
      if (std::abs(end) != 1) end = end * wider + along;
    }
  }
  place_markers(other);
  return other;
}

}  // namespace finsight::host
