// The measurement block: from the nouns of the data path to what clients read. And the settings that clients change.
#pragma once

#include <array>

#include "firmware/modbus/register_table.h"
#include "firmware/types.h"

namespace finsight {

enum StatusBit : std::uint16_t {
  kReady = 1 << 0,
  kTouchValid = 1 << 1,
  kContact = 1 << 2,
  kShapeValid = 1 << 3,
  kHeld = 1 << 4,
  kTopSeen = 1 << 5,
  kMiddleSeen = 1 << 6,
  kLowSeen = 1 << 7,
  kZeroed = 1 << 8,
  kOverRange = 1 << 9,
  kCameraFault = 1 << 10,
  kSolverFallback = 1 << 11,
  kSettingsUnsaved = 1 << 12,
  kOverload = 1 << 14,
  kAnyFault = 1 << 15,
};

/// Register 1. Codes are part of the interface: never renumber.
enum class FaultCode : std::uint16_t {
  kNone = 0,
  kCameraLost = 1,
  kMarkersLost = 2,
  kSolverFailed = 3,
  kSelfTest = 4,
  kSettingsRefused = 5,
  kFailedRepeatedly = 6,
  kSavedSettings = 7,
  kStalled = 8,
  kCameraFrozen = 9,
  kTooDark = 10,
  kTooBright = 11,
  kBlurred = 12,
  kCameraMoved = 13
};

/// What clients can change while the device works: the settings as their registers hold them.
struct RuntimeSettings {
  std::array<std::uint16_t, kSettingCount> words;

  RuntimeSettings() {
    for (int i = 0; i < kSettingCount; ++i) words[static_cast<std::size_t>(i)] = setting_row(i).factory;
  }
  std::uint16_t& operator[](Setting setting) { return words[setting]; }
  std::uint16_t operator[](Setting setting) const { return words[setting]; }
  bool operator==(const RuntimeSettings&) const = default;
};

/// Every setting in its range, and every threshold's "on" above its "off".
bool are_valid(const RuntimeSettings& settings);

/// Register 44. Each is set at its "on" threshold and cleared below its "off" one.
struct ThresholdState {
  bool contact = false, gentle = false, overload = false;
};

/// What the loop knows beside the nouns of the data path.
struct LoopState {
  std::uint16_t heartbeat = 0;
  std::uint32_t frames = 0;         ///< frames processed since the start
  std::uint32_t frame_counter = 0;  ///< the camera's counter of the published frame
  std::uint32_t dropped_frames = 0;
  std::int64_t exposure_ns = 0, published_ns = 0;  ///< steady clock
  bool camera_fault = false;
  FaultCode fault = FaultCode::kNone;
  bool zeroed = false, settings_unsaved = false;
  ThresholdState limits;
  std::uint32_t model_checksum = 0;
  float rated_deformation_mm = 1;
  RuntimeSettings settings;
};

/// The limits of this frame, with those of the frame before. A finger that is bent further than can be measured is in
/// contact. Without a valid value a limit is not reached.
ThresholdState next_threshold_state(const ThresholdState& before, const FingerShape& shape, const Touch& touch,
                                    float rated_deformation_mm, const RuntimeSettings& settings);

/// Writes the whole measurement block (register_table.h). A measured value that is not valid or not finite
/// becomes -32768 (int16), 65535 (uint16) or NaN (float32); one out of range saturates just short of that. Register 3
/// (age) stays 0: it is written by set_age.
void encode_registers(const PlatePoses& poses, const FingerShape& shape, const Touch& touch, const LoopState& state,
                      RegisterImage& image);

/// The block before any result: not ready, no valid value.
RegisterImage empty_block();

/// Register 3: from the exposure to `now_ns`, the moment of a read (steady clock).
void set_age(RegisterImage& image, std::int64_t now_ns);

/// For a block that should have been replaced long ago: not ready, no valid touch or shape, and a fault.
void mark_stalled(RegisterImage& image);

}  // namespace finsight
