// finsightd: settings -> model -> self-test -> loop. The only catch-all of the firmware.
#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <future>
#include <iterator>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "firmware/device/finger.h"
#include "firmware/device/identity.h"
#include "firmware/device/log.h"
#include "firmware/device/network_file.h"
#include "firmware/device/realtime.h"
#include "firmware/device/safe_mode.h"
#include "firmware/input_error.h"
#include "firmware/loop/self_test.h"
#include "firmware/settings/atomic_file.h"

namespace {

using namespace finsight;

constexpr const char* kUsage =
    "finsightd: a soft finger's camera in, touch on Modbus registers out.\n"
    "\n"
    "usage: finsightd --settings FILE [--user FILE] [--registers CSV | --check | --safe-outputs | ...]\n"
    "  --settings FILE   board file (TOML); boards/replay/board.toml is one with every key explained\n"
    "  --user FILE       its values replace the board file's\n"
    "  --registers CSV   at the end, write the published register blocks to this file (the first 262144); with\n"
    "                    [[finger]] tables one file for each, registers-NAME.csv for registers.csv\n"
    "  --check           read settings and model, run the self-test, and stop\n"
    "  --safe-outputs    set the digital outputs to their safe levels, and stop: for after a crash\n"
    "  --identity        print serial number, ports and write key, and stop\n"
    "  --network FILE    write the [network] section for systemd-networkd to this file, and stop\n"
    "  --safe-mode CODE  only serve a fault, for five minutes: that the firmware ended repeatedly with this exit code\n"
    "  --help, --version\n"
    "\n"
    "Stops on SIGINT and SIGTERM, or at the end of a recording that does not repeat.\n"
    "exit codes: 0 done, 1 failed at work (port in use, camera lost), 2 bad settings, model or recording,\n"
    "            3 the model's self-test gave other answers than expected\n";
static_assert(RegisterLog::kMaxBlocks == 262144);

std::atomic<bool> stop_requested{false};

struct Arguments {
  std::string settings, user, registers, network, safe_mode;
  bool check = false, safe_outputs = false, identity = false;
};

/// That of --safe-mode: a number, or a signal's name, as systemd's MONITOR_EXIT_STATUS has them.
void check_exit_code(const std::string& code) {
  const bool is_number = code.find_first_not_of("0123456789") == std::string::npos;
  const bool is_signal = code.find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789+-") == std::string::npos;
  if (is_signal && (!is_number || code.size() <= 3)) return;
  throw InputError("--safe-mode", "code", "\"" + code + "\"", "an exit code, or a signal such as ABRT");
}

/// Throws InputError naming the option.
Arguments parse(int argc, char** argv) {
  Arguments arguments;
  const std::pair<const char*, std::string*> valued[] = {{"--settings", &arguments.settings},
                                                         {"--user", &arguments.user},
                                                         {"--registers", &arguments.registers},
                                                         {"--network", &arguments.network},
                                                         {"--safe-mode", &arguments.safe_mode}};
  for (int i = 1; i < argc; ++i) {
    std::string word = argv[i];
    std::optional<std::string> value;  // of --name=value
    if (const auto equals = word.find('='); word.starts_with("--") && equals != std::string::npos) {
      value = word.substr(equals + 1);
      word.resize(equals);
    }
    const auto option = std::find_if(std::begin(valued), std::end(valued), [&](auto& v) { return word == v.first; });
    if (option != std::end(valued)) {
      const bool follows = !value && i + 1 < argc && std::strncmp(argv[i + 1], "--", 2) != 0;
      if (follows) value = argv[++i];
      if (!value || value->empty()) throw InputError(word, "needs a value (try --help)");
      if (!option->second->empty()) throw InputError(word, "is given twice");
      *option->second = *value;
    } else if (value) {
      throw InputError("\"" + word + "\"", "takes no value, or is unknown (try --help)");
    } else if (word == "--check") {
      arguments.check = true;
    } else if (word == "--safe-outputs") {
      arguments.safe_outputs = true;
    } else if (word == "--identity") {
      arguments.identity = true;
    } else {
      throw InputError("\"" + word + "\"",
                       word.starts_with("-") ? "unknown option (try --help)" : "belongs to no option (try --help)");
    }
  }
  if (arguments.settings.empty()) throw InputError("--settings", "is missing (try --help)");
  const int instead = arguments.check + arguments.safe_outputs + arguments.identity + !arguments.network.empty() +
                      !arguments.safe_mode.empty() + !arguments.registers.empty();
  if (instead > 1) {
    throw InputError("--registers, --check, --safe-outputs, --identity, --network, --safe-mode", "only one of them");
  }
  check_exit_code(arguments.safe_mode);
  return arguments;
}

/// Exit codes; kStartAgain is start()'s alone: it is to be called again.
enum ExitCode : int { kStartAgain = -1, kDone = 0, kFailed = 1, kInputRefused = 2, kSelfTestFailed = 3 };

/// A pack, recording, lens, mount or fit that cannot be used costs one of several fingers its values, and the others
/// nothing; then `fault` says which.
std::unique_ptr<Sensor> open_sensor(const Settings& settings, bool is_alone, FaultCode& fault) {
  try {
    return std::make_unique<Sensor>(settings, true);
  } catch (const SelfTestError& error) {
    if (is_alone) throw;
    fault = FaultCode::kSelfTest;
    log_message(settings.name, error.what());
  } catch (const InputError& error) {
    if (is_alone) throw;
    fault = FaultCode::kSettingsRefused;
    log_message(settings.name, error.what());
  }
  return nullptr;
}

/// Tells of every finger what is wrong with it.
int check(const std::vector<Settings>& fingers) {
  int code = kDone;
  for (const Settings& settings : fingers) {
    try {
      check_realtime(settings.realtime);
      const Sensor opened(settings, false);
      if (settings.gpio && has_gpio()) check_gpio(*settings.gpio);
      if (settings.gpio && !has_gpio()) log_message("gpio: not checked, this build has no libgpiod 2");
    } catch (const SelfTestError& error) {
      code = std::max<int>(code, kSelfTestFailed);
      log_message(settings.name, error.what());
    } catch (const InputError& error) {
      code = std::max<int>(code, kInputRefused);
      log_message(settings.name, error.what());
    }
  }
  return code;
}

/// A file per finger: "registers.csv", or "registers-left.csv" for the one called left.
std::string log_file_of(const std::string& registers, const std::string& finger) {
  if (registers.empty() || finger.empty()) return registers;
  std::filesystem::path file = registers;
  return file.replace_filename(file.stem().string() + "-" + finger + file.extension().string());
}

/// All fingers' loops, each in a thread of its own: the first in this one. Throws what one of them throws.
bool run_all(std::vector<std::unique_ptr<Finger>>& fingers, SharedDevice& device) {
  const auto run = [&device](Finger& finger) {
    try {
      return finger.run(device);
    } catch (...) {
      device.is_over = true;
      throw;
    }
  };
  std::vector<std::future<bool>> others;
  for (std::size_t i = 1; i < fingers.size(); ++i) {
    others.push_back(std::async(std::launch::async, [&run, &finger = *fingers[i]] { return run(finger); }));
  }
  bool done = run(*fingers[0]);
  for (std::future<bool>& other : others) done = other.get() && done;
  return done;
}

/// A reset that a finger's client ordered.
struct OrderedReset {
  std::size_t finger;
  GivenCommand command;
};

/// The work itself. Opens everything in an order in which every thread starts before a loop becomes real-time.
/// `reset`: the command that it was started again by, and again is to be.
int measure(const Arguments& arguments, std::vector<Settings> settings, std::optional<OrderedReset>& reset) {
  if (arguments.check) return check(settings);
  for (const Settings& finger : settings) check_realtime(finger.realtime);
  spread_over_processors(settings);
  std::vector<std::unique_ptr<Sensor>> sensors;
  std::vector<FaultCode> faults(settings.size(), FaultCode::kNone);
  for (std::size_t i = 0; i < settings.size(); ++i) {
    sensors.push_back(open_sensor(settings[i], settings.size() == 1, faults[i]));
  }
  const auto working = static_cast<int>(std::ranges::count_if(sensors, [](const auto& sensor) { return !!sensor; }));
  if (working == 0) throw InputError(arguments.settings, "none of its fingers can work");
  ZeroTogether zeros(settings.size());
  std::vector<std::unique_ptr<Finger>> fingers;
  std::vector<Control*> controls;
  for (std::size_t i = 0; i < settings.size(); ++i) {
    fingers.push_back(std::make_unique<Finger>(settings[i], std::move(sensors[i]), faults[i],
                                               log_file_of(arguments.registers, settings[i].name),
                                               OtherFingers{&zeros, i}));
    controls.push_back(&fingers.back()->control());
  }
  if (reset && reset->finger < controls.size()) controls[reset->finger]->remember(reset->command);
  ModbusServer server(settings[0].modbus, controls, [](const std::string& text) { log_message(text); });
  log_message("Modbus TCP on " + settings[0].modbus.address + ":" + std::to_string(server.port()));
  Supervisor supervisor(fingers.size());
  SharedDevice device{server, supervisor, stop_requested, working};
  supervisor.ready();
  if (!run_all(fingers, device)) throw std::runtime_error("gpio: the outputs can no longer be set");
  int code = kDone;
  for (const auto& finger : fingers) {
    if (!finger->close()) code = kInputRefused;
  }
  const auto ordered = std::ranges::find_if(fingers, [](const auto& finger) { return finger->reset_is_ordered(); });
  if (!stop_requested && ordered != fingers.end()) {
    log_message("a client ordered a reset");
    reset = {static_cast<std::size_t>(ordered - fingers.begin()), (*ordered)->control().last_finished()};
    return kStartAgain;
  }
  return code;
}

/// The fault that safe mode serves after the firmware ended with this exit code.
FaultCode fault_after(const std::string& exit_code) {
  if (exit_code == std::to_string(kInputRefused)) return FaultCode::kSettingsRefused;
  return exit_code == std::to_string(kSelfTestFailed) ? FaultCode::kSelfTest : FaultCode::kFailedRepeatedly;
}

/// What people and programs find the device by.
int print_identity(const Settings& settings) {
  std::printf("serial=%s\nmodbus_port=%d\npage_port=%s\nwrite_key=%d\n",
              identity_of(settings, nullptr).serial_number.c_str(), settings.modbus.port,
              settings.page ? std::to_string(settings.page->port).c_str() : "", settings.write_key);
  return kDone;
}

int start(const Arguments& arguments, std::optional<OrderedReset>& reset) {
  const SettingsFiles files(arguments.settings, arguments.user);
  if (arguments.identity) return print_identity(read_usable_settings(files));
  if (!arguments.check && !arguments.safe_outputs && arguments.network.empty()) {
    if (const auto page = read_usable_settings(files).page) keep_log(page->folder);
  }
  if (!arguments.safe_mode.empty()) {
    SafeMode(files, fault_after(arguments.safe_mode)).run(stop_requested);
    return kDone;
  }
  if (!arguments.network.empty()) {
    write_file_atomically(arguments.network, networkd_file(read_network_settings(files)));
    return 0;
  }
  if (arguments.safe_outputs) {
    for (const Settings& finger : read_usable_fingers(files)) {
      const DigitalOutputs safe(finger.gpio);  // takes the lines at their safe levels
    }
    return 0;
  }
  return measure(arguments, read_fingers(files), reset);
}

}  // namespace

int main(int argc, char** argv) {
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--help") == 0) return std::fputs(kUsage, stdout) < 0;
    if (std::strcmp(argv[i], "--version") == 0) return std::puts("finsightd " FINSIGHT_VERSION) < 0;
  }
  const auto request_stop = [](int) { stop_requested = true; };
  std::signal(SIGINT, request_stop);
  std::signal(SIGTERM, request_stop);
  try {
    const Arguments arguments = parse(argc, argv);
    const SchedulingSnapshot before;
    std::optional<OrderedReset> reset;
    for (;;) {
      const int code = start(arguments, reset);
      if (code != kStartAgain) return code;
      before.restore();
    }
  } catch (const SelfTestError& error) {
    log_message(error.what());
    return kSelfTestFailed;
  } catch (const InputError& error) {
    log_message(error.what());
    return kInputRefused;
  } catch (const std::exception& error) {
    log_message(error.what());
    return kFailed;
  }
}
