// Who this device is, and how warm its processor.
#pragma once

#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "firmware/modbus/control.h"
#include "firmware/settings/settings.h"

namespace finsight {

/// Model (none where it cannot be opened: null), serial number (the board file's, or else the board's own from its
/// device tree, or else 16 digits made from the machine id) and date of calibration (the board file's, or else the day
/// on which the newest of the files with lens and mount was written). `image`: a file that says which version of the
/// appliance's image runs, and from which slot; without it there is no image.
DeviceIdentity identity_of(const Settings& settings, const Model* model,
                           const std::filesystem::path& image = "/run/finsight/image");

/// Reads the processor's temperature once a second in a thread of its own, because some sensors take milliseconds.
class Thermometer {
 public:
  explicit Thermometer(Control& control);

 private:
  void run(const std::stop_token& stop);
  Control& control_;
  std::mutex mutex_;
  std::condition_variable_any wait_;
  std::jthread thread_;
};

/// In degrees Celsius; nothing if the system has no sensor.
std::optional<float> processor_temperature_degc();

}  // namespace finsight
