// The register table: one list in code from which the server, the README's table and registers.csv come.
#pragma once

#include <string>

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
  kOverTemperature = 1 << 13,
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
  kFailedRepeatedly = 6
};

enum class WordOrder : std::uint8_t { kABCD, kCDAB };

/// What the loop knows beside the nouns of the data path.
struct LoopState {
  std::uint16_t heartbeat = 0;
  std::uint32_t frames = 0;         ///< frames processed since the start
  std::uint32_t frame_counter = 0;  ///< the camera's counter of the published frame
  std::uint32_t dropped_frames = 0;
  std::int64_t exposure_ns = 0, published_ns = 0;  ///< steady clock
  bool camera_fault = false;
  FaultCode fault = FaultCode::kNone;
  std::uint32_t model_checksum = 0;
  float rated_deformation_mm = 1;
  WordOrder word_order = WordOrder::kABCD;
};

/// Writes the whole measurement block (the table in registers.cpp). A measured value that is not valid or not finite
/// becomes -32768 (int16), 65535 (uint16) or NaN (float32); one out of range saturates just short of that. Register 3
/// (age) stays 0: it is written by set_age.
void encode_registers(const PlatePoses& poses, const FingerShape& shape, const Touch& touch, const LoopState& state,
                      RegisterImage& image);

/// Register 3: from the exposure to `now_ns`, the moment of a read (steady clock).
void set_age(RegisterImage& image, std::int64_t now_ns);

/// The table in two forms, generated from the list that the encoder takes its addresses and scales from: for the
/// README, and comma-separated (RFC 4180, ASCII) for import by a PLC's programming tool.
std::string register_table_markdown();
std::string register_table_csv();

}  // namespace finsight
