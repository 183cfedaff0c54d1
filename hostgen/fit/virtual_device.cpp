#include "hostgen/fit/virtual_device.h"

#include <algorithm>
#include <cmath>

#include "firmware/calibrate/mount_estimate.h"
#include "hostgen/finger/plate_motion.h"

namespace finsight::host {

namespace {

constexpr std::size_t kSmallPicture = 1;    // 640x480
constexpr double kCornerScatter_px = 0.05;  // the spec's noise is that of such corners
constexpr int kSteps = 4;

LoopSettings without_shape(LoopSettings settings) {
  settings.shape.tier = ShapeSettings::Tier::kMeasures;
  return settings;
}

}  // namespace

VirtualDevice::VirtualDevice(const Model& model, const FingerSpec& believed, const VirtualFinger& finger,
                             const std::vector<LoopSettings>& settings, std::uint64_t seed)
    : real_lens_(finger.spec.cameras[kSmallPicture]),
      lens_(believed.cameras[kSmallPicture]),
      finger_(finger),
      random_(seed),
      estimator_(measured_mount(model.mount), model.prior, lens_.fx) {
  for (const LoopSettings& one : settings) {
    loops_.push_back(std::make_unique<FrameLoop>(model, std::nullopt, without_shape(one)));
  }
  zero({});
}

bool VirtualDevice::zero(const std::array<PlateMotion, kPlates>& plates) {
  for (const auto& loop : loops_) loop->zeroing().begin();
  bool done = true;
  for (std::size_t answered = 0; answered < loops_.size();) {
    measure(plates, kFrame_s);
    for (const auto& loop : loops_) {
      const auto outcome = loop->zeroing().take_outcome();
      if (!outcome) continue;
      ++answered;
      done = done && *outcome;
    }
  }
  return done;
}

std::vector<TouchReading> VirtualDevice::measure(const std::array<PlateMotion, kPlates>& plates, double after_s,
                                                 int frames) {
  std::vector<TouchReading> readings;
  for (int frame = 0; frame < frames; ++frame) {
    const double step_s = frame == 0 ? after_s - kFrame_s * (frames - 1) : kFrame_s;
    time_s_ += step_s;
    // A touch that changes between distant frames is not a shaken hand.
    sequence_ += frame == 0 && after_s > 2 * kFrame_s ? 100 : 1;
    const Observation observed{
        .exposure_ns = static_cast<std::int64_t>(time_s_ * 1e9), .sequence = sequence_, .poses = seen(plates)};
    readings.clear();
    for (const auto& loop : loops_) {
      loop->step(observed);
      readings.push_back(touch_reading(*loop, time_s_));
    }
  }
  return readings;
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
