#include "firmware/loop/process_values.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace finsight {

namespace {

constexpr std::int64_t kLongestGap_ns = 200'000'000;  // after a longer one the low-pass starts over
constexpr double kCountsPerUnit = 10;                 // of settings 1100 (Hz) and 1101

/// A first-order low-pass delays a steady change by its time constant.
float delay_of(const RuntimeSettings& settings) {
  const double cut_off_hz = settings[kLowpass] / kCountsPerUnit;
  return cut_off_hz > 0 ? static_cast<float>(1000 / (2 * std::numbers::pi * cut_off_hz)) : 0;
}

}  // namespace

void ProcessValues::update(const Observation& seen, const PlatePoses& poses, const FingerShape& shape,
                           const Touch& touch, const ThresholdState& limits, const RuntimeSettings& settings) {
  readings_.lowpass_delay_ms = delay_of(settings);
  const auto value = [&](int which, float measured, Quality quality) {
    filter(which, measured, std::isfinite(measured) ? quality : Quality::kInvalid, seen.exposure_ns);
  };
  // A finger that moves as a whole is not deformed, whatever its shape says.
  const Quality deformation = seen.moved_as_one || seen.camera_moved ? Quality::kInvalid : shape.quality;
  value(kForceValue, touch.force_n, touch.quality);
  value(kDeformationValue, shape.front_rms_mm, deformation);
  for (int axis = 0; axis < 3; ++axis) value(kTouchX + axis, touch.point_mm[axis], touch.quality);
  carry_out_tare();
  for (int which = 0; which < kProcessValues; ++which) show(which);
  if (poses.quality != Quality::kFresh) return;
  watch(touch, limits);
  const float changes = static_cast<float>(settings[kGripChange] / kCountsPerUnit);
  if (deformation == Quality::kFresh && grip_.update(limits.contact, touch, shape.front_rms_mm, changes)) {
    note(kGripChanged);
  }
  readings_.grip_steady = grip_.is_steady();
}

void ProcessValues::filter(int value, float measured, Quality quality, std::int64_t now_ns) {
  Channel& channel = channels_[value];
  channel.fresh = quality == Quality::kFresh;
  if (quality == Quality::kInvalid) {
    channel.measured_ns = 0;
    readings_.net[value] = ProcessReadings::kNone;
    return;
  }
  if (quality == Quality::kHeld) return;
  const std::int64_t elapsed_ns = now_ns - channel.measured_ns;
  const bool follows = channel.measured_ns != 0 && elapsed_ns > 0 && elapsed_ns < kLongestGap_ns;
  const float elapsed_ms = static_cast<float>(elapsed_ns) * 1e-6F;
  const float share = follows ? elapsed_ms / (readings_.lowpass_delay_ms + elapsed_ms) : 1;
  channel.filtered = follows ? channel.filtered + share * (measured - channel.filtered) : measured;
  channel.measured_ns = now_ns;
}

void ProcessValues::show(int value) {
  const Channel& channel = channels_[value];
  if (!channel.fresh) return;
  const float net = readings_.net[value] = channel.filtered - channel.offset;
  readings_.peak[value] = std::fmax(readings_.peak[value], net);  // of a number and NaN the number
  readings_.minimum[value] = std::fmin(readings_.minimum[value], net);
}

// Compared with the last frame that showed the finger: what happened between them is one event at most.
void ProcessValues::watch(const Touch& touch, const ThresholdState& limits) {
  if (limits.contact && !in_contact_) note(kContactMade);
  if (!limits.contact && in_contact_) note(kContactLost);
  in_contact_ = limits.contact;
  const bool overloaded = limits.overload || touch.over_range;
  if (overloaded && !overloaded_) note(kOverloadEvent);
  overloaded_ = overloaded;
}

void ProcessValues::note(ProcessEvent event) {
  readings_.event[event] = true;
  ++readings_.count[event];
}

void ProcessValues::carry_out_tare() {
  if (!ordered_) return;
  switch (*std::exchange(ordered_, std::nullopt)) {
    case Tare::kForce:
      outcome_ = tare(kForceValue, 1, readings_.force_tared);
      break;
    case Tare::kDeformation:
      outcome_ = tare(kDeformationValue, 1, readings_.deformation_tared);
      break;
    case Tare::kTouch:
      outcome_ = tare(kTouchX, 3, readings_.touch_tared);
      break;
  }
}

bool ProcessValues::tare(int first, int count, bool& is_tared) {
  const auto begin = channels_.begin() + first, end = begin + count;
  if (!std::all_of(begin, end, [](const Channel& channel) { return channel.fresh; })) return false;
  is_tared = true;
  for (int value = first; value < first + count; ++value) {
    channels_[value].offset = channels_[value].filtered;
    forget_peaks(value);
  }
  return true;
}

void ProcessValues::forget_peaks(int value) {
  readings_.peak[value] = readings_.minimum[value] = ProcessReadings::kNone;
}

void ProcessValues::clear_tare() {
  for (int value = 0; value < kProcessValues; ++value) {
    if (channels_[value].offset != 0) forget_peaks(value);
    channels_[value].offset = 0;
  }
  readings_.force_tared = readings_.deformation_tared = readings_.touch_tared = false;
}

void ProcessValues::reset_peaks() {
  for (int value = 0; value < kProcessValues; ++value) forget_peaks(value);
}

void ProcessValues::reset_events() {
  readings_.event = {};
  readings_.count = {};
}

void ProcessValues::reset() {
  clear_tare();
  reset_peaks();
  for (int value = 0; value < kProcessValues; ++value) {
    channels_[value] = {};
    readings_.net[value] = ProcessReadings::kNone;
  }
  grip_.reset();
  readings_.grip_steady = false;
}

}  // namespace finsight
