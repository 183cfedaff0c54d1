// A virtual finger in a device: what its registers say when it is touched. From loads to registers without images.
#pragma once

#include <vector>

#include "firmware/loop/frame_loop.h"
#include "hostgen/fem/statics.h"
#include "firmware/vision/plate_estimator.h"
#include "hostgen/render/virtual_finger.h"

namespace finsight::host {

/// How a place of a finger answers to a normal force: finite-element states of that finger, and what lies between them.
class PressedPlace {
 public:
  /// Solves for up to `levels` forces, evenly spaced up to `highest_n` of a finger of the spec's own Young's modulus.
  /// Those that are no equilibrium are left out.
  PressedPlace(FingerStatics& statics, const Vec3f& point_mm, double highest_n, int levels);

  const Vec3f& point_mm() const { return point_mm_; }
  /// 0: the place gives way under any force.
  double highest_n() const { return force_n_.empty() ? 0 : force_n_.back(); }
  std::array<PlateMotion, kPlates> plates(double force_n) const;

 private:
  Vec3f point_mm_;
  std::vector<double> force_n_;
  std::vector<PoseVectorOf<double>> per_newton_;  ///< plate motion over force
};

/// What a client reads of one frame.
struct TouchReading {
  double time_s = 0;
  bool is_valid = false;
  Vec3f point_mm = Vec3f::Zero();
  double radius_mm = 0, force_n = 0, force_sigma_n = 0;
};
TouchReading touch_reading(const RegisterImage& image, double time_s);

/// The firmware, which takes the finger for one of its pack, and the finger's camera. At the start the mount is measured
/// and the finger zeroed, as whoever mounts it does.
class VirtualDevice {
 public:
  /// `believed`: the spec that the pack was made from. All arguments must outlive this.
  VirtualDevice(const Model& model, const FingerSpec& believed, const VirtualFinger& finger,
                const LoopSettings& settings, std::uint64_t seed);

  /// One frame of plates that are there `after_s` after the last one.
  TouchReading measure(const std::array<PlateMotion, kPlates>& plates, double after_s);
  /// The finger is let go, for long: nothing of what touched it is left.
  void rest();

 private:
  using Corners = std::array<std::array<Eigen::Vector2d, 4>, kPlates>;
  Corners corners_px(const std::array<PlateMotion, kPlates>& plates);
  MountModel measured_mount(const MountModel& nominal);
  PlatePoses seen(const std::array<PlateMotion, kPlates>& plates);

  const Lens &real_lens_, &lens_;
  const VirtualFinger& finger_;
  Random random_;
  PlateEstimator estimator_;
  FrameLoop loop_;
  double time_s_ = 0;
  std::uint32_t sequence_ = 0;
};

}  // namespace finsight::host
