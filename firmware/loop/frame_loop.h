// The stages of the data path in order; owns every workspace.
#pragma once

#include <cstdint>
#include <optional>

#include "firmware/loop/finger_fit.h"
#include "firmware/loop/gravity.h"
#include "firmware/loop/hold.h"
#include "firmware/loop/marker_places.h"
#include "firmware/loop/mount_check.h"
#include "firmware/loop/pose_filter.h"
#include "firmware/loop/process_values.h"
#include "firmware/loop/shake.h"
#include "firmware/loop/stage_times.h"
#include "firmware/loop/zero.h"
#include "firmware/modbus/registers.h"
#include "firmware/model/model.h"
#include "firmware/shape/shape_stage.h"
#include "firmware/touch/touch_stage.h"
#include "firmware/vision/observer.h"

namespace finsight {

struct LoopSettings {
  ShapeSettings shape;
  RuntimeSettings runtime;  ///< the first; see use()
  double readout_ms = 0;    ///< of a camera with a rolling shutter, see RollingShutter
  double smoothing_ms = 0;  ///< delay of the low-pass on plate motions, see PoseFilter; 0: none
  /// Of this device, instead of the model's. It was measured at rest and absorbs what a zero absorbs.
  std::optional<MountModel> mount = std::nullopt;
  std::optional<FitValues> fit = std::nullopt;  ///< of this finger
  /// The acceleration of things that fall, in the finger frame and in g, if the finger never turns. Nothing, or a rest
  /// that is not known, makes every touch less sure; these are for poses that are as in the pack.
  std::optional<Vec3f> fixed_g = Vec3f(0, 0, 0);
  bool rest_is_known = true;  ///< the poses are relative to this finger's own rest without a zero
};

/// Frame in, registers out. The model must outlive the loop. After construction nothing allocates (except OpenCV's
/// marker detector), throws, prints or waits; every stage always gives a value with a Quality.
class FrameLoop {
 public:
  /// Without a camera only recorded observations can be processed. Throws InputError for an impossible lens or
  /// mount.
  FrameLoop(const Model& model, const std::optional<Lens>& camera, const LoopSettings& settings);

  /// One frame through all stages: this function is the product. Needs the camera.
  const RegisterImage& step(const Frame& frame);

  /// The same from plates that were recorded instead of seen: motions from the model's rest. Those of plates that were
  /// not seen are completed from the model's prior.
  const RegisterImage& step(const Observation& recorded);

  /// No frame came until `now_ns` (steady clock): publishes the held values, or invalid ones after the hold time.
  const RegisterImage& step_without_frame(std::int64_t now_ns);

  /// From the next frame on.
  void use(const RuntimeSettings& settings) { state_.settings = settings; }
  Zeroing& zeroing() { return zeroing_; }
  const Zeroing& zeroing() const { return zeroing_; }
  /// From the next frame on; also with what the zero was measured.
  GravityCorrection& gravity() { return gravity_; }
  const GravityCorrection& gravity() const { return gravity_; }
  ProcessValues& process_values() { return process_; }
  void show_unsaved(bool unsaved) { state_.settings_unsaved = unsaved; }
  /// Stays, where the frame itself has no other fault, until it is set to kNone.
  void set_lasting_fault(FaultCode fault) { lasting_fault_ = fault; }
  /// From the next frame on: fault 14, where there is no other.
  void show_master_lost(bool lost) { master_lost_ = lost; }

  const StageTimes& times() const { return times_; }
  /// WarningBit, published from the next step on.
  void set_warnings(std::uint16_t bits) { state_.warnings = bits; }
  /// Days since 2000-01-01; 0: not known.
  void set_today(std::uint16_t day) { state_.today = day; }
  const LoopState& state() const { return state_; }
  const RegisterImage& registers() const { return registers_; }  ///< of the last frame

  /// What the last frame became on its way, for those who show it; valid until the next one.
  struct View {
    const MarkerCorners* corners = nullptr;  ///< null without a camera
    PlatePoses poses{};                      ///< as judged: zeroed, smoothed, held
    FingerShape shape{};
    float explained = 0;  ///< see Touch
  };
  const View& view() const { return view_; }

 private:
  const RegisterImage& process(Observation seen, StageClock clock);
  void zero(Observation& seen);
  Touch locate(const Observation& seen, const PlatePoses& poses, const PoseVector& motion);
  Touch as_fitted(Touch touch, const Observation& seen);
  void judge(const Observation& seen, const FingerShape& shape, const Touch& touch);
  const RegisterImage& publish(const Observation& seen, const PlatePoses& poses, const FingerShape& shape,
                               const Touch& touch);
  void count(const Observation& seen);

  const Model& model_;
  const bool rest_is_known_, mount_is_measured_;
  std::optional<Observer> observer_;
  GravityCorrection gravity_;
  Zeroing zeroing_;
  MarkerPlaces marker_places_;
  MountCheck mount_check_;
  Shake shake_;
  PoseFilter filter_;
  Hold hold_;
  ShapeStage shape_;
  TouchStage touch_;
  std::optional<FingerFit> fit_;
  ProcessValues process_;
  FaultCode lasting_fault_ = FaultCode::kNone;
  bool master_lost_ = false;
  std::uint32_t last_sequence_ = 0;
  LoopState state_;
  StageTimes times_;
  RegisterImage registers_;
  View view_;
};

}  // namespace finsight
