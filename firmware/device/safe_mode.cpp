#include "firmware/device/safe_mode.h"

#include <chrono>
#include <system_error>
#include <thread>

#include "firmware/device/commands.h"
#include "firmware/device/identity.h"
#include "firmware/device/log.h"
#include "firmware/device/saved_state.h"
#include "firmware/device/supervisor.h"
#include "firmware/input_error.h"

namespace finsight {

namespace {

/// All settings if they are valid, otherwise the valid parts of them. Reports what is wrong.
Settings settings_to_serve(const SettingsFiles& files) {
  try {
    return read_settings(files);
  } catch (const InputError& error) {
    log_message(error.what());
    return read_usable_settings(files);
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

std::unique_ptr<ModbusServer> open_server_with_fallback(const ModbusSettings& settings, Control& control) {
  try {
    return std::make_unique<ModbusServer>(settings, control, log_message);
  } catch (const std::system_error& error) {
    log_message(error.what());
    return std::make_unique<ModbusServer>(fallback_settings(settings), control, log_message);
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

SafeMode::SafeMode(const Settings& settings, FaultCode fault)
    : control_(settings.write_key, settings.loop.runtime, saved_settings(settings)) {
  state_.fault = fault;
  control_.identify(identity_in_safe_mode(settings, fault));
  try {
    outputs_.emplace(settings.gpio);
  } catch (const InputError& error) {
    log_message(error.what());
  }
  server_ = open_server_with_fallback(settings.modbus, control_);
}

bool SafeMode::run(const std::atomic<bool>& stop, std::chrono::nanoseconds longest) {
  log_message("SAFE MODE, fault " + std::to_string(static_cast<int>(state_.fault)) + "; Modbus TCP on port " +
              std::to_string(port()));
  Supervisor supervisor;
  supervisor.ready();
  RegisterImage image = empty_block();
  const std::int64_t end_ns = steady_now_ns() + longest.count();
  while (!stop) {
    const std::int64_t now_ns = steady_now_ns();
    if (now_ns > end_ns) return false;
    supervisor.alive_in_safe_mode(now_ns);
    ++state_.heartbeat;
    state_.settings = control_.settings();
    encode_registers(PlatePoses{}, FingerShape{}, Touch{}, state_, image);
    server_->publish(image);
    health_.note(image, false, now_ns, now_ns, {});
    if (const auto command = control_.take_command()) {
      control_.finish(*command == Command::kReset ? CommandResult::kDone : CommandResult::kNotPossible);
      if (*command == Command::kReset) {
        std::this_thread::sleep_for(std::chrono::nanoseconds(kResultIsShownNs));
        return false;
      }
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  return true;
}

}  // namespace finsight
