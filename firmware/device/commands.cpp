#include "firmware/device/commands.h"

#include <utility>

namespace finsight {

namespace {

CommandResult done_if(bool possible) { return possible ? CommandResult::kDone : CommandResult::kNotPossible; }

}  // namespace

Commands::Commands(Control& control, FrameLoop& loop, StateSaver* saver, Recorder* recorder, const SavedState& saved,
                   std::int64_t frame_timeout_ns, OtherFingers others)
    : control_(control),
      loop_(loop),
      saver_(saver),
      recorder_(recorder),
      frame_timeout_ns_(frame_timeout_ns),
      settings_(saved.settings),
      saved_(saved),
      others_(others) {
  loop_.zeroing().set_zero(saved.zero);
  loop_.gravity().set_at_zero(saved.zero_g);
}

void Commands::poll() {
  // What a command has done at once is told after the frame that shows it.
  if (const auto shown = std::exchange(done_at_once_, std::nullopt)) control_.finish(*shown);
  settings_ = control_.settings();
  loop_.use(settings_);
  control_.set_stale_after(kNsPerMs * settings_[kHoldTime] + frame_timeout_ns_);
  if (!is_running_) {
    if (others_.zeros && others_.zeros->take(others_.own)) {
      zero_for_another();
    } else if (const auto ordered = control_.take_command()) {
      running_ = *ordered;
      is_running_ = is_ordered_ = true;
      if (const auto result = start(running_)) {
        is_running_ = false;
        done_at_once_ = result;
      }
    }
  } else if (const auto result = outcome()) {
    is_running_ = false;
    if (is_ordered_) control_.finish(*result);
  }
  loop_.show_unsaved(zero_changed_ || settings_ != saved_.settings);
  loop_.gravity().set_felt(control_.felt_gravity(steady_now_ns()));
  loop_.show_master_lost(control_.is_master_lost(steady_now_ns()));
  if (recorder_) {
    control_.show_recording(static_cast<std::uint16_t>(recorder_->state()), recorder_->seconds(), recorder_->mb_left());
  }
}

void Commands::trigger() {
  const auto command = static_cast<Command>(settings_[kTriggerCommand]);
  if (is_running_ || command == Command::kNone) return;
  running_ = command;
  is_ordered_ = false;
  is_running_ = !start(command);
}

std::optional<bool> Commands::zero_outcome() {
  const auto done = loop_.zeroing().take_outcome();
  zero_changed_ = zero_changed_ || done.value_or(false);
  return done;
}

/// Another finger's client hears of it, not this one's.
void Commands::zero_for_another() {
  running_ = Command::kZero;
  is_running_ = is_zeroing_for_another_ = true;
  is_ordered_ = false;
  start(running_);
}

/// Two fingers whose clients order a zero of all at the same time: each one's own zero is what the other waits for.
std::optional<CommandResult> Commands::zero_all_outcome() {
  if (!own_zero_) own_zero_ = zero_outcome();
  if (!own_zero_) return std::nullopt;
  if (!others_.zeros) return done_if(*own_zero_);
  if (others_.zeros->take(others_.own)) others_.zeros->tell(others_.own, *own_zero_);
  const auto others = others_.zeros->outcome(others_.own);
  if (!others && steady_now_ns() - zero_all_since_ns_ < kZeroOfOthersNs) return std::nullopt;
  return done_if(*own_zero_ && others.value_or(false));
}

/// The result of a command that is carried out at once; nothing for one whose result outcome() gives later.
std::optional<CommandResult> Commands::start(Command command) {
  switch (command) {
    case Command::kNone:
      return CommandResult::kDone;
    case Command::kZero:
      loop_.zeroing().begin();
      return std::nullopt;
    case Command::kZeroAll:
      loop_.zeroing().begin();
      own_zero_.reset();
      zero_all_since_ns_ = steady_now_ns();
      if (others_.zeros) others_.zeros->order(others_.own);
      return std::nullopt;
    case Command::kSave:
      if (!saver_) return CommandResult::kNotConfigured;
      saver_->begin(saving_ = current());
      return std::nullopt;
    case Command::kClearFault:
      loop_.set_lasting_fault(FaultCode::kNone);
      return CommandResult::kDone;
    case Command::kRecord:
      return record(true);
    case Command::kStopRecording:
      return record(false);
    case Command::kReset:
      reset_at_ns_ = steady_now_ns() + kResultIsShownNs;
      return CommandResult::kDone;
    case Command::kTareForce:
      return tare(ProcessValues::Tare::kForce);
    case Command::kTareDeformation:
      return tare(ProcessValues::Tare::kDeformation);
    case Command::kTareTouch:
      return tare(ProcessValues::Tare::kTouch);
    case Command::kClearTare:
      loop_.process_values().clear_tare();
      return CommandResult::kDone;
    case Command::kResetPeaks:
      loop_.process_values().reset_peaks();
      return CommandResult::kDone;
    case Command::kResetEvents:
      loop_.process_values().reset_events();
      return CommandResult::kDone;
    case Command::kFactory:  // Control has replaced the settings already
      zero_changed_ = zero_changed_ || loop_.zeroing().zero();
      loop_.zeroing().set_zero(std::nullopt);
      loop_.gravity().set_at_zero(std::nullopt);
      return CommandResult::kDone;
  }
  return CommandResult::kNotPossible;
}

std::optional<CommandResult> Commands::record(bool start) {
  if (!recorder_) return CommandResult::kNotConfigured;
  const bool is_recording = recorder_->state() == Recorder::State::kRecording;
  if (start && (is_recording || recorder_->mb_left() == 0)) return CommandResult::kNotPossible;
  if (!start && !is_recording) return CommandResult::kDone;
  start ? recorder_->start() : recorder_->stop();
  return std::nullopt;
}

std::optional<CommandResult> Commands::tare(ProcessValues::Tare tare) {
  // Whoever ordered it during a stall saw no valid value.
  if (control_.stalled_since_ns(loop_.registers(), steady_now_ns()) != 0) return CommandResult::kNotPossible;
  loop_.process_values().order_tare(tare);
  return std::nullopt;
}

std::optional<CommandResult> Commands::outcome() {
  switch (running_) {
    case Command::kZero: {
      const auto done = zero_outcome();
      if (!done) return std::nullopt;
      if (std::exchange(is_zeroing_for_another_, false)) others_.zeros->tell(others_.own, *done);
      return done_if(*done);
    }
    case Command::kZeroAll:
      return zero_all_outcome();
    case Command::kTareForce:
    case Command::kTareDeformation:
    case Command::kTareTouch: {
      const auto done = loop_.process_values().take_tare_outcome();
      if (!done) return std::nullopt;
      return done_if(*done);
    }
    case Command::kSave: {
      const auto done = saver_->outcome();
      if (!done) return std::nullopt;
      if (*done) {
        saved_ = saving_;
        zero_changed_ = false;
      }
      return *done ? CommandResult::kDone : CommandResult::kFailed;
    }
    default:  // the recorder's commands
      if (!recorder_->is_settled()) return std::nullopt;
      return recorder_->state() == Recorder::State::kFailed ? CommandResult::kFailed : CommandResult::kDone;
  }
}

}  // namespace finsight
