#include "firmware/loop/frame_loop.h"

#include <cassert>

#include "firmware/loop/verdict.h"
#include "firmware/model/plate_prior.h"

namespace finsight {

FrameLoop::FrameLoop(const Model& model, const std::optional<Lens>& camera, const LoopSettings& settings)
    : model_(model),
      rest_is_known_(settings.rest_is_known || settings.mount.has_value()),
      mount_is_measured_(settings.mount.has_value()),
      gravity_(model.touch, settings.fixed_g),
      zeroing_(model.touch.threshold_mm),
      marker_places_(model.mount, settings.mount, model.touch),
      filter_(settings.smoothing_ms),
      shape_(model, settings.shape),
      touch_(model) {
  if (camera) {
    observer_.emplace(settings.mount.value_or(model.mount), model.prior, *camera,
                      static_cast<std::int64_t>(settings.readout_ms * kNsPerMs));
    view_.corners = &observer_->corners();
  }
  state_.model_checksum = model.checksum;
  state_.scene = scene_code(model.scene);
  state_.rated_deformation_mm = model.rated_deformation_mm;
  state_.settings = settings.runtime;
  state_.force_scale_sigma = model.touch.stiffness_tolerance;
  if (!settings.fit) return;
  fit_.emplace(*settings.fit);
  touch_.use_tolerances(settings.fit->force_sigma, settings.fit->touch_radius_mm, settings.fit->noise_per_mm);
  touch_.explain_less_likely(settings.fit->explained_lower);
  state_.force_scale = settings.fit->force_scale;
  state_.force_scale_sigma = settings.fit->force_scale_sigma;
  state_.fitted_on = settings.fit->fitted_on;
}

const RegisterImage& FrameLoop::step(const Frame& frame) {
  assert(observer_);
  const StageClock clock(true);
  return process(observer_->observe(frame, zeroing_.zero().value_or(ZeroPose{}), zeroing_.is_running()), clock);
}

const RegisterImage& FrameLoop::step(const Observation& recorded) {
  const StageClock clock(true);
  Observation seen = recorded;
  complete_from_prior(model_.prior, seen.poses);
  return process(seen, clock);
}

const RegisterImage& FrameLoop::step_without_frame(std::int64_t now_ns) {
  return process({.exposure_ns = now_ns, .sequence = last_sequence_, .image_fault = ImageFault::kMissing},
                 StageClock(false));
}

const RegisterImage& FrameLoop::process(Observation seen, StageClock clock) {
  zero(seen);
  const PlatePoses& poses = hold_.poses(seen.poses, seen.exposure_ns, state_.settings);
  const PoseVector motion = pose_vector(poses);
  clock.lap(times_.poses);
  const Touch& touch = hold_.touch(locate(seen, poses, motion));
  clock.lap(times_.touch);
  const FingerShape shape = hold_.shape(shape_.solve(poses, motion, !touch.unexplained));
  clock.lap(times_.shape);
  judge(seen, shape, touch);
  process_.update(seen, poses, shape, touch, state_.limits, state_.settings);
  const RegisterImage& registers = publish(seen, poses, shape, touch);
  view_.poses = poses;
  view_.shape = shape;
  view_.explained = touch.explained;
  clock.lap(times_.registers);
  clock.finish(times_.frame);
  return registers;
}

// Makes the poses relative to the zero and adds what can only be told from several frames.
void FrameLoop::zero(Observation& seen) {
  if (seen.image_fault == ImageFault::kMissing) zeroing_.cancel();
  const bool was_measuring = zeroing_.is_running();
  if (zeroing_.apply(seen.poses)) {
    if (was_measuring) gravity_.set_at_zero(gravity_.felt());
    zeroing_.zero() ? marker_places_.estimate(*zeroing_.zero()) : marker_places_.forget();
    mount_check_.reset();
    shake_.reset();
    filter_.reset();
    hold_.reset();
    process_.reset();
    if (fit_) fit_->reset();
    seen.rigid_motion.reset();
  }
  const bool is_zeroed = zeroing_.zero().has_value();
  if (seen.poses.quality == Quality::kFresh) {
    marker_places_.correct(seen.poses);
    if (fit_) fit_->change_motions(seen.poses);
    seen.unknown_g = gravity_.apply(is_zeroed || mount_is_measured_, seen.poses);
  }
  seen.is_from_rest = is_zeroed || rest_is_known_;
  seen.moved_as_one = seen.rigid_motion && MountCheck::is_rigid_motion(*seen.rigid_motion);
  seen.camera_moved = mount_check_.update(seen.poses, seen.rigid_motion);
  seen.shaken_mm = shake_.update(seen.poses, seen.sequence);
  filter_.apply(seen.poses, seen.exposure_ns);
}

// Held poses were located when they were fresh. No touch moves all plates as one rigid body.
Touch FrameLoop::locate(const Observation& seen, const PlatePoses& poses, const PoseVector& motion) {
  if (poses.quality != Quality::kFresh || seen.moved_as_one || seen.camera_moved) return {};
  return as_fitted(
      touch_.locate(poses, motion, {seen.shaken_mm, seen.unknown_g, seen.is_from_rest, marker_places_.doubts(poses)}),
      seen);
}

// Where the plates are not seen as they are now, the fit waits for them.
Touch FrameLoop::as_fitted(Touch touch, const Observation& seen) {
  if (!fit_ || touch.over_range) return touch;
  fit_->apply(Eigen::Map<const Eigen::Matrix3f>(model_.touch.face_axes.data()), seen.exposure_ns, touch);
  return touch;
}

void FrameLoop::judge(const Observation& seen, const FingerShape& shape, const Touch& touch) {
  if (touch.quality != Quality::kInvalid || touch.over_range) zeroing_.cancel();  // a touched finger is not at rest
  state_.camera_fault = seen.image_fault == ImageFault::kMissing || seen.image_fault == ImageFault::kFrozen;
  state_.fault = fault_of(seen, hold_.is_over(), shape, lasting_fault_);
  if (state_.fault == FaultCode::kNone && master_lost_) state_.fault = FaultCode::kMasterLost;
  state_.zeroed = zeroing_.zero().has_value();
  state_.limits = next_threshold_state(state_.limits, shape, touch, state_.rated_deformation_mm, state_.settings);
}

const RegisterImage& FrameLoop::publish(const Observation& seen, const PlatePoses& poses, const FingerShape& shape,
                                        const Touch& touch) {
  if (seen.image_fault != ImageFault::kMissing) count(seen);
  ++state_.heartbeat;
  state_.published_ns = steady_now_ns();
  encode_registers(poses, shape, touch, state_, registers_);
  encode_process(process_.readings(), registers_);
  return registers_;
}

// A counter that goes back is a camera that was started again: how many frames that cost is not known.
void FrameLoop::count(const Observation& seen) {
  const auto advance = static_cast<std::int32_t>(seen.sequence - last_sequence_);
  if (state_.frames > 0 && advance > 1) state_.dropped_frames += static_cast<std::uint32_t>(advance - 1);
  last_sequence_ = seen.sequence;
  ++state_.frames;
  state_.frame_counter = seen.sequence;
  state_.exposure_ns = seen.exposure_ns;
}

}  // namespace finsight
