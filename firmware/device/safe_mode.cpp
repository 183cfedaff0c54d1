#include "firmware/device/safe_mode.h"

#include <chrono>
#include <system_error>
#include <thread>

#include "firmware/device/identity.h"
#include "firmware/device/log.h"
#include "firmware/device/saved_state.h"
#include "firmware/input_error.h"
#include "firmware/ports/supervisor.h"

namespace finsight {

namespace {

/// All settings if they are valid, otherwise the valid parts of them. Reports what is wrong.
std::vector<Settings> settings_to_serve(const SettingsFiles& files) {
  try {
    return read_fingers(files);
  } catch (const InputError& error) {
    log_message(error.what());
    return read_usable_fingers(files);
  }
}

/// Reports what is wrong with the file; what it holds of settings is used as far as it is valid.
RuntimeSettings saved_settings(const Settings& settings) {
  const LoadedState loaded = load_state_or_factory(settings.saved_state, nullptr, settings.loop.runtime);
  if (!loaded.problem.empty()) log_message(loaded.problem);
  return loaded.state.settings;
}

/// Without a model where it cannot be opened, or may be what ends the firmware.
DeviceIdentity identity_in_safe_mode(const Settings& settings, FaultCode fault) {
  if (fault != FaultCode::kFailedRepeatedly && !settings.pack.empty()) {
    try {
      const Model model = Model::open(settings.pack);
      return identity_of(settings, &model);
    } catch (const InputError&) {
      // The settings' reader or the firmware's last start has said what is wrong.
    }
  }
  return identity_of(settings, nullptr);
}

std::unique_ptr<ModbusServer> open_server_with_fallback(const ModbusSettings& settings, Control& control,
                                                        std::size_t fingers, const RegisterImage& first) {
  const std::vector<Control*> controls(fingers, &control);
  const auto report = [](const std::string& text) { log_message(text); };
  try {
    return std::make_unique<ModbusServer>(settings, controls, report, first);
  } catch (const std::system_error& error) {
    log_message(error.what());
    return std::make_unique<ModbusServer>(fallback_settings(settings), controls, report, first);
  }
}

}  // namespace

ModbusSettings fallback_settings(const ModbusSettings& settings) {
  ModbusSettings fallback = settings;
  fallback.address = "0.0.0.0";
  fallback.port = 502;
  return fallback;
}

SafeMode::SafeMode(const SettingsFiles& files, FaultCode fault) : SafeMode(settings_to_serve(files), fault) {}

SafeMode::SafeMode(const std::vector<Settings>& fingers, FaultCode fault)
    : fault_code_(fault),
      control_(fingers[0].write_key, fingers[0].loop.runtime, saved_settings(fingers[0])),
      fault_(control_, fault),
      fingers_(fingers.size()) {
  control_.identify(identity_in_safe_mode(fingers[0], fault));
  for (const Settings& finger : fingers) {
    try {
      outputs_.push_back(std::make_unique<DigitalOutputs>(finger.gpio));
    } catch (const InputError& error) {
      log_message(error.what());
    }
  }
  server_ = open_server_with_fallback(fingers[0].modbus, control_, fingers_, fault_.next(steady_now_ns()));
}

bool SafeMode::run(const std::atomic<bool>& stop, std::chrono::nanoseconds longest) {
  log_message("SAFE MODE, fault " + std::to_string(static_cast<int>(fault_code_)) + "; Modbus TCP on port " +
              std::to_string(port()));
  Supervisor supervisor;
  supervisor.ready();
  const std::int64_t end_ns = steady_now_ns() + longest.count();
  while (!stop) {
    const std::int64_t now_ns = steady_now_ns();
    if (now_ns > end_ns || fault_.reset_is_due(now_ns)) return false;
    supervisor.alive_without_sensor(now_ns);
    const RegisterImage& image = fault_.next(now_ns);
    for (std::size_t finger = 0; finger < fingers_; ++finger) server_->publish(image, finger);
    std::this_thread::sleep_for(std::chrono::milliseconds(FaultBlock::kEvery_ms));
  }
  return true;
}

}  // namespace finsight
