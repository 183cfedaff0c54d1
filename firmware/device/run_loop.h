// A finger at work: frames in, registers and outputs out.
#pragma once

#include <atomic>

#include "firmware/device/commands.h"
#include "firmware/device/health.h"
#include "firmware/device/outputs.h"
#include "firmware/device/page_publisher.h"
#include "firmware/device/register_log.h"
#include "firmware/device/source.h"
#include "firmware/ports/supervisor.h"
#include "firmware/modbus/server.h"

namespace finsight {

/// What the fingers' loops share.
struct SharedDevice {
  ModbusServer& server;
  Supervisor& supervisor;
  const std::atomic<bool>& stop;  ///< from outside
  std::atomic<int> sources;       ///< that still give frames
  std::atomic<bool> is_over{false};
};

/// What works together while frames come, for one finger. All threads beside the loops' exist before these start, so
/// that none inherits a loop's processor or priority.
struct FingerAtWork {
  std::size_t finger;       ///< its place among the device's
  const std::string& name;  ///< empty on a board that has only one
  const OpenSource& source;
  FrameLoop& loop;
  Commands& commands;
  DigitalOutputs& outputs;
  RegisterLog& log;
  Health& health;
  Recorder* recorder;   ///< may be null
  PagePublisher* page;  ///< may be null
};

/// Runs until `stop` is set, the recordings of all fingers have ended, or a client orders a reset or another loop
/// fails. A finger whose recording has ended publishes that nothing comes any more while the others go on. Waits at
/// most `timeout_ms` for a frame. False: the outputs can no longer be set, and the device is over.
bool run_loop(FingerAtWork work, SharedDevice& device, int timeout_ms);

}  // namespace finsight
