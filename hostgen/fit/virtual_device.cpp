#include "hostgen/fit/virtual_device.h"

#include <algorithm>
#include <cmath>

#include "firmware/calibrate/mount_estimate.h"
#include "firmware/modbus/register_table.h"
#include "hostgen/finger/plate_motion.h"

namespace finsight::host {

namespace {

constexpr std::size_t kSmallPicture = 1;   // 640x480
constexpr double kCornerScatter_px = 0.05;  // the spec's noise is that of such corners
constexpr int kSteps = 4;

LoopSettings without_shape(LoopSettings settings) {
  settings.shape.tier = ShapeSettings::Tier::kMeasures;
  return settings;
}

}  // namespace

PressedPlace::PressedPlace(FingerStatics& statics, const Vec3f& point_mm, double highest_n, int levels)
    : point_mm_(point_mm) {
  statics.reset();
  for (int i = 1; i <= levels; ++i) {
    const double force_n = highest_n * i / levels;
    if (!statics.load(point_mm, force_n)) return;
    const FemState state = statics.state();
    if (!state.valid()) return;
    point_mm_ = state.point_mm;
    PlatePoses poses{.plates = state.plates};
    force_n_.push_back(force_n);
    per_newton_.push_back(pose_vector(poses).cast<double>() / force_n);
  }
}

// Motion over force changes slowly and has a limit at rest: the polynomial through all of them.
std::array<PlateMotion, kPlates> PressedPlace::plates(double force_n) const {
  PoseVectorOf<double> sum = PoseVectorOf<double>::Zero();
  for (std::size_t i = 0; i < force_n_.size(); ++i) {
    double weight = 1;
    for (std::size_t j = 0; j < force_n_.size(); ++j) {
      if (j != i) weight *= (force_n - force_n_[j]) / (force_n_[i] - force_n_[j]);
    }
    sum += weight * per_newton_[i];
  }
  const PoseVector numbers = (force_n * sum).cast<float>();
  return seen_poses({numbers.data(), kPoseDims}).plates;
}

TouchReading touch_reading(const RegisterImage& image, double time_s) {
  TouchReading reading{.time_s = time_s};
  reading.is_valid = image.words[address_of("status")] & kTouchValid;
  if (!reading.is_valid) return reading;
  for (int i = 0; i < 3; ++i) reading.point_mm[i] = static_cast<float>(measured_value(image, address_of("touch_x") + i));
  reading.radius_mm = measured_value(image, address_of("touch_uncertainty"));
  reading.force_n = measured_value(image, address_of("force"));
  reading.force_sigma_n = measured_value(image, address_of("force_uncertainty"));
  return reading;
}

VirtualDevice::VirtualDevice(const Model& model, const FingerSpec& believed, const VirtualFinger& finger,
                             const LoopSettings& settings, std::uint64_t seed)
    : real_lens_(finger.spec.cameras[kSmallPicture]),
      lens_(believed.cameras[kSmallPicture]),
      finger_(finger),
      random_(seed),
      estimator_(measured_mount(model.mount), model.prior, lens_.fx),
      loop_(model, std::nullopt, without_shape(settings)) {
  rest();
  loop_.zeroing().begin();
  while (!loop_.zeroing().take_outcome()) measure({}, 1.0 / 60);
}

void VirtualDevice::rest() {
  for (int i = 0; i < 30; ++i) measure({}, 10);
}

TouchReading VirtualDevice::measure(const std::array<PlateMotion, kPlates>& plates, double after_s) {
  time_s_ += after_s;
  sequence_ += after_s > 0.5 ? 100 : 1;  // frames far apart: nothing is shaken
  const Observation observed{.exposure_ns = static_cast<std::int64_t>(time_s_ * 1e9),
                             .sequence = sequence_,
                             .poses = seen(plates)};
  return touch_reading(loop_.step(observed), time_s_);
}

VirtualDevice::Corners VirtualDevice::corners_px(const std::array<PlateMotion, kPlates>& plates) {
  Corners pixels;
  for (std::size_t p = 0; p < kPlates; ++p) {
    const Eigen::Isometry3d marker = T_camera_marker(finger_.spec, p, plates[p]);
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::Vector3d corner = marker * marker_corner(finger_.spec.marker_size_mm, k);
      pixels[p][k] = pixel_from_ray(real_lens_, corner.head<2>() / corner.z());
      for (double& x : pixels[p][k]) x += kCornerScatter_px * random_.normal();
    }
  }
  return pixels;
}

MountModel VirtualDevice::measured_mount(const MountModel& nominal) {
  RestingCorners resting{.lens = lens_, .corner_px = {}, .frames = 60};
  for (auto& marker : resting.corner_px) marker.fill(Eigen::Vector2d::Zero());
  for (int frame = 0; frame < resting.frames; ++frame) {
    const Corners pixels = corners_px({});
    for (std::size_t p = 0; p < kPlates; ++p) {
      for (std::size_t k = 0; k < 4; ++k) resting.corner_px[p][k] += pixels[p][k] / resting.frames;
    }
  }
  return corrected_mount(nominal, estimate_mount(nominal, resting, "virtual finger").mount);
}

PlatePoses VirtualDevice::seen(const std::array<PlateMotion, kPlates>& plates) {
  const Corners pixels = corners_px(plates);
  PlateSight sight;
  sight.seen.fill(true);
  for (std::size_t p = 0; p < kPlates; ++p) {
    for (std::size_t k = 0; k < 4; ++k) sight.rays[p][k] = ray_from_pixel(lens_, pixels[p][k]);
  }
  const PoseVectorOf<double> start = pose_vector(PlatePoses{.plates = plates}).cast<double>();
  const PlateEstimator::Vector found = estimator_.estimate(sight, start, kSteps);
  const PoseVector numbers = found.cast<float>();
  PlatePoses poses = seen_poses({numbers.data(), kPoseDims});
  poses.noise = estimator_.noise(sight, found);
  return poses;
}

}  // namespace finsight::host
