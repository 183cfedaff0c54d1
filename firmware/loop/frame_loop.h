// The stages of the data path in order; owns every workspace.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "firmware/loop/mount_check.h"
#include "firmware/loop/pose_filter.h"
#include "firmware/loop/shake.h"
#include "firmware/loop/stage_times.h"
#include "firmware/loop/zero.h"
#include "firmware/modbus/registers.h"
#include "firmware/model/model.h"
#include "firmware/shape/shape_stage.h"
#include "firmware/touch/touch_stage.h"
#include "firmware/vision/vision_stages.h"

namespace finsight {

struct LoopSettings {
  ShapeSettings shape;
  RuntimeSettings runtime;                         ///< the first; see use()
  double smoothing_ms = 0;                         ///< delay of the low-pass on plate motions, see PoseFilter; 0: none
  std::optional<MountModel> mount = std::nullopt;  ///< of this device, instead of the model's
};

/// Frame in, registers out. The model must outlive the loop. After construction nothing allocates (but OpenCV's marker
/// detector), throws, prints or waits; every stage always gives a value with a Quality.
class FrameLoop {
 public:
  /// Without a camera only frames that carry recorded poses can be processed. Throws InputError for a camera model that
  /// cannot be one, and for a measured mount that cannot be this finger's.
  FrameLoop(const Model& model, const std::optional<Lens>& camera, const LoopSettings& settings);

  /// One frame through all stages: this function is the product.
  const RegisterImage& step(const Frame& frame);

  /// No frame came until `now_ns` (steady clock): republishes what is held, or invalid values after the hold time.
  const RegisterImage& step_without_frame(std::int64_t now_ns);

  /// From the next frame on.
  void use(const RuntimeSettings& settings) { state_.settings = settings; }
  Zeroing& zeroing() { return zeroing_; }
  void show_unsaved(bool unsaved) { state_.settings_unsaved = unsaved; }
  /// Stays, where the frame itself has no other fault, until it is set to kNone.
  void set_lasting_fault(FaultCode fault) { lasting_fault_ = fault; }

  const StageTimes& times() const { return times_; }
  const LoopState& state() const { return state_; }

 private:
  PlatePoses measure_poses(const Frame& frame);
  const PlatePoses& hold_poses(const PlatePoses& measured, std::int64_t now_ns);
  void check_mount(const Frame& frame);
  const Touch& locate(const PlatePoses& poses);
  void count_frame(const Frame& frame);
  FaultCode fault(const FingerShape& shape) const;
  const RegisterImage& publish(const PlatePoses& poses, const FingerShape& shape, const Touch& touch);

  struct Vision {
    Vision(const MountModel& mount, const PlatePrior& prior, const Lens& lens)
        : markers(mount, in_single_precision(lens)), poses(mount, prior, in_single_precision(lens)) {}
    MarkerStage markers;
    ImageCheck check;
    PoseStage poses;
  };
  const Model& model_;
  std::optional<Vision> vision_;
  ShapeStage shape_;
  TouchStage touch_;
  const Touch no_touch_{};  ///< what plates tell that moved as one, and while the camera is not where it was
  Zeroing zeroing_;
  MountCheck mount_check_;
  Shake shake_;
  float shaken_mm_ = 0;
  PoseFilter filter_;
  PlatePoses measured_;  ///< of this frame, completed and zeroed
  PlatePoses held_;      ///< the last ones that were fresh
  std::int64_t held_since_ns_ = 0;
  bool hold_is_over_ = true;
  ImageFault image_fault_ = ImageFault::kNone;
  bool camera_moved_ = false;
  bool one_body_ = false;  ///< this frame's plates have moved as one
  FaultCode lasting_fault_ = FaultCode::kNone;
  std::uint32_t last_sequence_ = 0;
  LoopState state_;
  StageTimes times_;
  RegisterImage registers_;
};

}  // namespace finsight
