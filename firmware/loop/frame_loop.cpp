#include "firmware/loop/frame_loop.h"

#include <cstdio>

#include "firmware/model/plate_prior.h"

namespace finsight {

FrameLoop::FrameLoop(const Model& model, const std::optional<Lens>& camera, const LoopSettings& settings)
    : model_(model),
      shape_(model, settings.shape),
      touch_(model),
      zeroing_(model.touch.threshold_mm),
      filter_(settings.smoothing_ms) {
  if (camera) vision_.emplace(settings.mount.value_or(model.mount), model.prior, *camera);
  state_.model_checksum = model.checksum;
  state_.rated_deformation_mm = model.rated_deformation_mm;
  state_.settings = settings.runtime;
}

const RegisterImage& FrameLoop::step(const Frame& frame) {
  const std::int64_t start_ns = steady_now_ns();
  count_frame(frame);
  measured_ = measure_poses(frame);
  if (zeroing_.process(measured_)) mount_check_.begin_anew();
  check_mount(frame);
  shaken_mm_ = shake_.look(measured_, frame.sequence);
  filter_.process(measured_, frame.exposure_ns);
  const PlatePoses& poses = hold_poses(measured_, frame.exposure_ns);
  const std::int64_t poses_ns = steady_now_ns();
  const FingerShape& shape = shape_.solve(poses);
  const std::int64_t shape_ns = steady_now_ns();
  const Touch& touch = locate(poses);
  if (touch.quality != Quality::kInvalid || touch.over_range) zeroing_.give_up();  // what is touched is not at rest
  const std::int64_t touch_ns = steady_now_ns();
  const RegisterImage& registers = publish(poses, shape, touch);
  const std::int64_t end_ns = steady_now_ns();

  times_.poses.add(poses_ns - start_ns);
  times_.shape.add(shape_ns - poses_ns);
  times_.touch.add(touch_ns - shape_ns);
  times_.registers.add(end_ns - touch_ns);
  times_.frame.add(end_ns - start_ns);
  return registers;
}

const RegisterImage& FrameLoop::step_without_frame(std::int64_t now_ns) {
  state_.camera_fault = true;
  image_fault_ = ImageFault::kNone;
  zeroing_.give_up();
  const PlatePoses& poses = hold_poses(PlatePoses{}, now_ns);
  return publish(poses, shape_.solve(poses), locate(poses));
}

PlatePoses FrameLoop::measure_poses(const Frame& frame) {
  if (vision_ && !frame.poses) {
    image_fault_ = vision_->check.look({frame.grey, frame.width_px, frame.height_px, frame.stride_bytes});
    state_.camera_fault = image_fault_ == ImageFault::kFrozen;
    if (vision_->check.repeats()) return PlatePoses{};  // what an old image shows is not measured
    return vision_->poses.estimate(vision_->markers.find(frame));
  }
  PlatePoses poses = frame.poses ? *frame.poses : PlatePoses{};
  complete_from_prior(model_.prior, poses);
  return poses;
}

// Recorded plates are nobody's camera.
void FrameLoop::check_mount(const Frame& frame) {
  one_body_ = false;
  if (!vision_ || frame.poses || measured_.seen_count() < kPlates) return;
  const RigidMotionFit fit = vision_->poses.as_one_body(zeroing_.zero().value_or(ZeroPose{}));
  one_body_ = MountCheck::is_one_body(fit);
  camera_moved_ = mount_check_.look(measured_, fit);
}

const Touch& FrameLoop::locate(const PlatePoses& poses) {
  return camera_moved_ || one_body_ ? no_touch_ : touch_.locate(poses, shaken_mm_);
}

// Short gaps (a hand before the light, a lost frame) repeat the last poses, marked as held. Longer ones are a fault,
// and invalid, or still held where the settings want that.
const PlatePoses& FrameLoop::hold_poses(const PlatePoses& measured, std::int64_t now_ns) {
  if (measured.quality == Quality::kFresh) {
    held_ = measured;
    held_since_ns_ = now_ns;
    hold_is_over_ = false;
    return held_;
  }
  constexpr std::int64_t kNsPerMs = 1'000'000;
  const RuntimeSettings& settings = state_.settings;
  if (now_ns - held_since_ns_ > kNsPerMs * settings[kHoldTime]) hold_is_over_ = true;
  if (held_.quality != Quality::kInvalid) {
    held_.quality = hold_is_over_ && settings[kAfterHold] == 0 ? Quality::kInvalid : Quality::kHeld;
    held_.seen = measured.seen;
  }
  return held_;
}

// A counter that goes back is a camera that was started anew: how many frames that cost is not known.
void FrameLoop::count_frame(const Frame& frame) {
  state_.camera_fault = false;
  const auto advance = static_cast<std::int32_t>(frame.sequence - last_sequence_);
  if (state_.frames > 0 && advance > 1) state_.dropped_frames += static_cast<std::uint32_t>(advance - 1);
  last_sequence_ = frame.sequence;
  ++state_.frames;
  state_.frame_counter = frame.sequence;
  state_.exposure_ns = frame.exposure_ns;
}

// The first that holds; what explains another comes before it.
FaultCode FrameLoop::fault(const FingerShape& shape) const {
  if (image_fault_ == ImageFault::kFrozen) return FaultCode::kCameraFrozen;
  if (state_.camera_fault) return FaultCode::kCameraLost;
  if (hold_is_over_ && image_fault_ == ImageFault::kDark) return FaultCode::kTooDark;
  if (hold_is_over_ && image_fault_ == ImageFault::kBright) return FaultCode::kTooBright;
  if (image_fault_ == ImageFault::kBlurred && measured_.seen_count() < kPlates) return FaultCode::kBlurred;
  if (hold_is_over_) return FaultCode::kMarkersLost;
  if (camera_moved_) return FaultCode::kCameraMoved;
  return shape.fallback ? FaultCode::kSolverFailed : lasting_fault_;
}

const RegisterImage& FrameLoop::publish(const PlatePoses& poses, const FingerShape& shape, const Touch& touch) {
  state_.fault = fault(shape);
  state_.zeroed = zeroing_.zero().has_value();
  state_.limits = next_threshold_state(state_.limits, shape, touch, state_.rated_deformation_mm, state_.settings);
  ++state_.heartbeat;
  state_.published_ns = steady_now_ns();
  encode_registers(poses, shape, touch, state_, registers_);
  return registers_;
}

std::string StageTimes::table() const {
  std::string text = "stage      frames      p50 us      p99 us    worst us\n";
  const auto row = [&](const char* name, const TimeHistogram& times) {
    char line[96];
    std::snprintf(line, sizeof line, "%-9s %7llu %11.0f %11.0f %11.0f\n", name,
                  static_cast<unsigned long long>(times.count()), times.percentile_us(0.5), times.percentile_us(0.99),
                  times.worst_us());
    text += line;
  };
  row("poses", poses);
  row("shape", shape);
  row("touch", touch);
  row("registers", registers);
  row("frame", frame);
  return text;
}

}  // namespace finsight
