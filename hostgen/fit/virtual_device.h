// A virtual finger in a device: what its registers say when it is touched. From loads to registers without images.
#pragma once

#include <memory>
#include <vector>

#include "firmware/vision/plate_estimator.h"
#include "hostgen/fit/touch_reading.h"
#include "hostgen/render/virtual_finger.h"

namespace finsight::host {

/// Devices with different settings that see the same finger through the same camera and take it for one of their pack.
/// At the start the mount is measured and the finger zeroed, as whoever mounts it does.
class VirtualDevice {
 public:
  static constexpr double kFrame_s = 1.0 / 60;

  /// `believed`: the spec that the pack was made from. All arguments but the settings must outlive this.
  VirtualDevice(const Model& model, const FingerSpec& believed, const VirtualFinger& finger,
                const std::vector<LoopSettings>& settings, std::uint64_t seed);

  /// Looks at plates for some frames, kFrame_s apart, the last of them `after_s` after the last one before; a reading
  /// per setting, of that frame.
  std::vector<TouchReading> measure(const std::array<PlateMotion, kPlates>& plates, double after_s, int frames = 1);
  /// Takes the plates as they are for the finger at rest. False: that was refused.
  bool zero(const std::array<PlateMotion, kPlates>& plates);

 private:
  using Corners = std::array<std::array<Eigen::Vector2d, 4>, kPlates>;
  Corners corners_px(const std::array<PlateMotion, kPlates>& plates);
  MountModel measured_mount(const MountModel& nominal);
  PlatePoses seen(const std::array<PlateMotion, kPlates>& plates);

  const Lens &real_lens_, &lens_;
  const VirtualFinger& finger_;
  Random random_;
  PlateEstimator estimator_;
  std::vector<std::unique_ptr<FrameLoop>> loops_;
  double time_s_ = 0;
  std::uint32_t sequence_ = 0;
};

}  // namespace finsight::host
