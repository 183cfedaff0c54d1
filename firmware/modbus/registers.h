// From the values of the data path to the block of measurements that clients read; and the settings that clients
// change.
#pragma once

#include <array>
#include <limits>
#include <string>

#include "firmware/modbus/register_table.h"
#include "firmware/types.h"

namespace finsight {

/// Register 0.
enum StatusBit : std::uint16_t {
  kReady = bit_named("status", "ready"),
  kTouchValid = bit_named("status", "touch_valid"),
  kContact = bit_named("status", "contact"),
  kShapeValid = bit_named("status", "shape_valid"),
  kHeld = bit_named("status", "held"),
  kTopSeen = bit_named("status", "top_plate_seen"),
  kMiddleSeen = bit_named("status", "middle_plate_seen"),
  kLowSeen = bit_named("status", "low_plate_seen"),
  kZeroed = bit_named("status", "zeroed"),
  kOverRange = bit_named("status", "over_range"),
  kCameraFault = bit_named("status", "camera_fault"),
  kSolverFallback = bit_named("status", "solver_fallback"),
  kSettingsUnsaved = bit_named("status", "settings_unsaved"),
  kUnexplained = bit_named("status", "unexplained"),
  kOverload = bit_named("status", "overload"),
  kAnyFault = bit_named("status", "any_fault"),
};

/// Register 1.
enum class FaultCode : std::uint16_t {
  kNone = value_named("fault", "none"),
  kCameraLost = value_named("fault", "camera_lost"),
  kMarkersLost = value_named("fault", "markers_lost"),
  kSolverFailed = value_named("fault", "solver_failed"),
  kSelfTest = value_named("fault", "self_test_failed"),
  kSettingsRefused = value_named("fault", "settings_or_model_refused"),
  kFailedRepeatedly = value_named("fault", "failed_repeatedly"),
  kSavedSettings = value_named("fault", "saved_settings_refused"),
  kStalled = value_named("fault", "stalled"),
  kCameraFrozen = value_named("fault", "camera_frozen"),
  kTooDark = value_named("fault", "image_too_dark"),
  kTooBright = value_named("fault", "image_too_bright"),
  kBlurred = value_named("fault", "image_out_of_focus"),
  kCameraMoved = value_named("fault", "camera_moved"),
  kMasterLost = value_named("fault", "master_lost"),
};

/// Register 45.
enum WarningBit : std::uint16_t {
  kCameraSlow = bit_named("warnings", "camera_slow"),
  kPicturesBroken = bit_named("warnings", "pictures_broken"),
  kNotVerified = bit_named("warnings", "not_verified"),
};

/// The settings that clients can change while the device runs, as their registers hold them.
struct RuntimeSettings {
  std::array<std::uint16_t, kSettingCount> words;

  RuntimeSettings() {
    for (int i = 0; i < kSettingCount; ++i) words[static_cast<std::size_t>(i)] = setting_row(i).factory;
  }
  std::uint16_t& operator[](Setting setting) { return words[setting]; }
  std::uint16_t operator[](Setting setting) const { return words[setting]; }
  bool operator==(const RuntimeSettings&) const = default;
};

/// Whether every setting is in its range and every "on" threshold above its "off" threshold.
bool are_valid(const RuntimeSettings& settings);

/// The order of 32-bit registers.
bool has_low_word_first(const RuntimeSettings& settings);

/// Register 44. Each is set at its "on" threshold and cleared below its "off" threshold.
struct ThresholdState {
  bool contact = false, gentle = false, overload = false;
};

/// The values that the process helpers work on, in the order of registers 1120, 1125 and 1130.
enum ProcessValue : int { kForceValue, kDeformationValue, kTouchX, kTouchY, kTouchZ, kProcessValues };
/// What is latched and counted, in the order of register 1110's bits and of the counters behind it.
enum ProcessEvent : int { kContactMade, kContactLost, kOverloadEvent, kGripChanged, kProcessEvents };

/// Registers 1110 to 1134. NaN: not valid, or none yet.
struct ProcessReadings {
  using Values = std::array<float, kProcessValues>;
  static constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

  Values net = {kNone, kNone, kNone, kNone, kNone};
  Values peak = net, minimum = net;  ///< of net
  std::array<bool, kProcessEvents> event{};
  std::array<std::uint16_t, kProcessEvents> count{};
  bool force_tared = false, deformation_tared = false, touch_tared = false;
  bool grip_steady = false;
  float lowpass_delay_ms = 0;
};

/// Register 80: the code of a pack's scene.
std::uint16_t scene_code(const std::string& scene);

/// What the registers show besides poses, shape and touch.
struct LoopState {
  std::uint16_t heartbeat = 0;
  std::uint32_t frames = 0;         ///< processed since the start
  std::uint32_t frame_counter = 0;  ///< the camera's counter of the published frame
  std::uint32_t dropped_frames = 0;
  std::int64_t exposure_ns = 0, published_ns = 0;  ///< steady clock
  bool camera_fault = false;
  std::uint16_t warnings = 0;  ///< WarningBit
  FaultCode fault = FaultCode::kNone;
  bool zeroed = false, settings_unsaved = false;
  ThresholdState limits;
  std::uint32_t model_checksum = 0;
  std::uint16_t scene = 0;  ///< scene_code() of the model's
  float force_scale = 1, force_scale_sigma = 0;
  std::uint16_t fitted_on = 0, today = 0;  ///< days since 2000-01-01; 0: never, not known
  float rated_deformation_mm = 1;
  RuntimeSettings settings;
};

/// The thresholds after this frame; `before` is their state after the previous one. A finger bent beyond the range of
/// the training is in contact. A threshold whose value is not valid is cleared.
ThresholdState next_threshold_state(const ThresholdState& before, const FingerShape& shape, const Touch& touch,
                                    float rated_deformation_mm, const RuntimeSettings& settings);

/// Writes the whole block of measurements (register_table.h). A value that is not valid or not finite becomes
/// -32768 (int16), 65535 (uint16) or NaN (float32); one that is out of range saturates just short of that. Register 3
/// (age) stays 0; set_age writes it.
void encode_registers(const PlatePoses& poses, const FingerShape& shape, const Touch& touch, const LoopState& state,
                      RegisterImage& image);

/// Writes the process helpers' registers.
void encode_process(const ProcessReadings& readings, RegisterImage& image);

/// A single register of the measurements, in its unit; NaN where it is not valid.
double measured_value(const RegisterImage& image, int address);

/// The block before the first result: not ready, no valid values.
RegisterImage empty_block();

/// Writes register 3, the time from the exposure to a read at `now_ns` (steady clock).
void set_age(RegisterImage& image, std::int64_t now_ns);

/// Changes the order of a block's 32-bit registers, if it is the other one: a block made before setting 1019 was
/// changed.
void use_word_order(RegisterImage& image, bool low_word_first);

/// Makes a block that should have been replaced by now say so: fault 8, not ready. Everything but its age that is not
/// always valid becomes invalid, and the bits of the old frame are cleared; where setting 1017 (after_hold) says keep,
/// all of that stays, marked as held.
void mark_stalled(RegisterImage& image, const RuntimeSettings& settings);

}  // namespace finsight
