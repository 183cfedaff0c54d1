// When the firmware cannot work: clients see why, and the outputs stay safe.
#pragma once

#include <atomic>
#include <chrono>
#include <memory>
#include <optional>
#include <vector>

#include "firmware/device/fault_block.h"
#include "firmware/device/outputs.h"
#include "firmware/modbus/server.h"
#include "firmware/settings/settings.h"

namespace finsight {

/// Where a client looks first, with all restrictions of `settings` kept: for when its own address and port do not work.
ModbusSettings fallback_settings(const ModbusSettings& settings);

/// Serves a fault under every finger's unit id, who the device is, and nothing that was measured. Needs neither model
/// nor camera, and only those settings that are valid. Of the commands only reset is carried out.
class SafeMode {
 public:
  /// Opens outputs and server. Throws std::system_error if not even the fallback port can be opened.
  SafeMode(const SettingsFiles& files, FaultCode fault);
  int port() const { return server_->port(); }
  /// Until `stop` is set (true); or a client ordered a reset and has had the time to read its result, or the time is
  /// over (false): then the sensor may be tried again. A camera may be back.
  bool run(const std::atomic<bool>& stop, std::chrono::nanoseconds longest = std::chrono::minutes(5));

 private:
  SafeMode(const std::vector<Settings>& fingers, FaultCode fault);
  const FaultCode fault_code_;
  Control control_;
  FaultBlock fault_;
  std::vector<std::unique_ptr<DigitalOutputs>> outputs_;  ///< never set, so they stay safe
  const std::size_t fingers_;
  std::unique_ptr<ModbusServer> server_;
};

}  // namespace finsight
