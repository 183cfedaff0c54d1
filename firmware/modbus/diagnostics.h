// What the diagnostics registers (3000 on) show beside the measurements: what the server counts, what the frame loop
// tells about itself, and who the device is.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <string>

#include "firmware/modbus/exception.h"
#include "firmware/modbus/register_table.h"

namespace finsight {

/// What does not change while the firmware runs. Texts are cut after 32 characters.
struct DeviceIdentity {
  std::uint32_t model_checksum = 0;
  std::uint32_t calibration_date = 0;  ///< as 20261122; 0: not known
  std::string model_name, serial_number;
  std::uint32_t image_made = 0;  ///< as the register of this name
  std::uint16_t image_slot = 0;  ///< code of the register of this name
};

struct FaultRecord {
  std::uint16_t code = 0;
  std::int64_t began_ns = 0, ended_ns = 0;  ///< steady clock; ended at 0: it still stands
};

/// The frame loop's view of itself, published with every frame. NaN: not known.
struct LoopHealth {
  float frame_rate_hz = std::numeric_limits<float>::quiet_NaN();
  float load = std::numeric_limits<float>::quiet_NaN();  ///< share of the time that it works
  std::uint32_t frames = 0, dropped = 0, camera_losses = 0, pictures_broken = 0;
  float camera_rate_hz = std::numeric_limits<float>::quiet_NaN();  ///< what the camera gives
  std::int64_t longest_ns = 0;
  std::array<FaultRecord, kFaultEntries> faults{};  ///< the newest first
  std::uint32_t faults_counted = 0;

  /// The fault that is published from now on; it may be the same as before.
  void note_fault(std::uint16_t code, std::int64_t now_ns);
  /// What clients are shown while the frame loop stalls and cannot tell it itself.
  void mark_stalled(std::int64_t since_ns);
};

/// Since the start.
struct ServerCounts {
  std::uint32_t open = 0;  ///< connections now
  std::uint32_t accepted = 0, refused = 0, replaced = 0, requests = 0;
  std::array<std::uint32_t, 7> exceptions{};  ///< by code
  std::uint32_t wrong_keys = 0, wrong_key_client = 0;
};

/// The whole block.
void write_diagnostics(const ServerCounts& counts, const LoopHealth& health, const DeviceIdentity& identity,
                       float processor_temperature_degc, std::int64_t started_ns, std::int64_t now_ns,
                       bool low_word_first, std::span<std::uint16_t, kDiagnosticsRegisters> words);

}  // namespace finsight
