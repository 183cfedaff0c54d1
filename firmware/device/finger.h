// One finger of the device: everything that exists once per finger.
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "firmware/device/commands.h"
#include "firmware/device/fault_block.h"
#include "firmware/device/health.h"
#include "firmware/device/identity.h"
#include "firmware/device/outputs.h"
#include "firmware/device/page_publisher.h"
#include "firmware/device/recorder.h"
#include "firmware/device/register_log.h"
#include "firmware/device/run_loop.h"
#include "firmware/device/source.h"

namespace finsight {

/// What a finger measures with: its model, which has passed its self-test, and its camera or recording.
struct Sensor {
  /// Throws InputError for a pack, recording, lens, mount or fit that cannot be used, and SelfTestError.
  /// `takes_import`: of what was imported on the page.
  Sensor(const Settings& settings, bool takes_import);

  const Model model;
  const std::optional<SessionInfo> images;
  const LoopSettings loop_settings;
  FrameLoop loop;
  const OpenSource source;
  const ZeroBasis basis;
  const LoadedState saved;
};

/// A finger at work, or one whose sensor cannot be used and which serves a fault beside the others.
class Finger {
 public:
  /// Opens its outputs, files and threads. Without a sensor it serves `fault`. `registers`: see RegisterLog.
  Finger(const Settings& settings, std::unique_ptr<Sensor> sensor, FaultCode fault, const std::string& registers,
         OtherFingers others);

  Control& control() { return control_; }
  bool measures() const { return sensor_ != nullptr; }
  const std::string& name() const { return settings_.name; }
  bool reset_is_ordered() const { return is_reset_ordered_; }

  /// In the thread that is to be its own. False: the outputs can no longer be set. Throws std::runtime_error if the
  /// system refuses the thread's real-time settings.
  bool run(SharedDevice& device);
  /// After run(): writes the registers' log and what the loop has to say. False: the recording ended too early, which
  /// run() has logged.
  bool close();

 private:
  void serve_fault(SharedDevice& device);

  const Settings settings_;
  const std::unique_ptr<Sensor> sensor_;
  const OtherFingers others_;
  Control control_;
  std::optional<StateSaver> saver_;
  std::optional<Recorder> recorder_;
  std::optional<PagePublisher> page_;
  DigitalOutputs outputs_;
  std::optional<Commands> commands_;
  std::optional<FaultBlock> fault_;  ///< of a finger without a sensor
  const Thermometer thermometer_;
  Health health_;
  const std::string registers_;
  RegisterLog log_;
  bool is_reset_ordered_ = false;
};

}  // namespace finsight
