// The device at work: frames in, registers and outputs out.
#pragma once

#include <atomic>

#include "firmware/device/commands.h"
#include "firmware/device/health.h"
#include "firmware/device/outputs.h"
#include "firmware/device/page_publisher.h"
#include "firmware/device/register_log.h"
#include "firmware/device/source.h"
#include "firmware/modbus/server.h"

namespace finsight {

/// What works together while frames come. All threads beside the loop's exist before it starts, so that none inherits
/// its processor or priority.
struct Device {
  const OpenSource& source;
  FrameLoop& loop;
  Commands& commands;
  ModbusServer& server;
  DigitalOutputs& outputs;
  RegisterLog& log;
  Health& health;
  Recorder* recorder;   ///< may be null
  PagePublisher* page;  ///< may be null
};

/// Runs until `stop` is set, the recording ends, or a client orders a reset. Waits at most `timeout_ms` for a frame.
/// False: the outputs can no longer be set.
bool run_loop(Device device, int timeout_ms, const std::atomic<bool>& stop);

}  // namespace finsight
