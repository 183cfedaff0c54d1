// finsightd: settings -> model -> self-test -> loop. The only catch-all of the firmware.
#include <algorithm>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <iterator>
#include <optional>
#include <string>
#include <utility>

#include "firmware/device/identity.h"
#include "firmware/device/log.h"
#include "firmware/device/network_file.h"
#include "firmware/device/realtime.h"
#include "firmware/device/run_loop.h"
#include "firmware/device/safe_mode.h"
#include "firmware/device/source.h"
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
    "  --registers CSV   at the end, write the published register blocks to this file (the first 262144)\n"
    "  --check           read settings and model, run the self-test, and stop\n"
    "  --safe-outputs    set the digital outputs to their safe levels, and stop: for after a crash\n"
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
  bool check = false, safe_outputs = false;
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
    } else {
      throw InputError("\"" + word + "\"",
                       word.starts_with("-") ? "unknown option (try --help)" : "belongs to no option (try --help)");
    }
  }
  if (arguments.settings.empty()) throw InputError("--settings", "is missing (try --help)");
  const int instead = arguments.check + arguments.safe_outputs + !arguments.network.empty() +
                      !arguments.safe_mode.empty() + !arguments.registers.empty();
  if (instead > 1) throw InputError("--registers, --check, --safe-outputs, --network, --safe-mode", "only one of them");
  check_exit_code(arguments.safe_mode);
  return arguments;
}

/// Exit codes; kStartAgain is start()'s alone: it is to be called again.
enum ExitCode : int { kStartAgain = -1, kDone = 0, kFailed = 1, kInputRefused = 2, kSelfTestFailed = 3 };

/// A page that cannot be shown is no reason not to measure.
void open_page(const Settings& settings, const Model& model, const std::optional<SessionInfo>& images,
               const MountModel& mount, std::optional<PagePublisher>& page) {
  try {
    page.emplace(settings, model, images, mount);
  } catch (const std::exception& error) {
    log_message(std::string(error.what()) + "; the page (page.folder) will show no live values");
  }
}

/// What was imported on the page takes the place of what was saved. A file that cannot be used is put aside.
void take_imported(const Settings& settings, const ZeroBasis& basis) {
  if (!settings.page || settings.page->measured.empty() || settings.saved_state.empty()) return;
  const std::filesystem::path file = settings.page->measured / kImportedState;
  try {
    if (!std::filesystem::is_regular_file(file)) return;
    const std::optional<LoadedState> imported = load_state(file, &basis);
    if (!imported) return;
    if (!imported->problem.empty()) throw InputError(imported->problem, "nothing of the import is used");
    save_state(settings.saved_state, imported->state, basis);
    log_message("settings and zero were imported on the page");
  } catch (const InputError& error) {
    log_message(error.what());
  }
  std::filesystem::remove(file);
}

/// The work itself. Opens everything in an order in which every thread starts before the loop becomes real-time.
/// `reset`: the command that it was started again by, and again is to be.
int measure(const Arguments& arguments, const Settings& settings, std::optional<GivenCommand>& reset) {
  const Model model = Model::open(settings.pack);
  check_self_test(model);
  log_message("model " + model.finger_name + " (" + std::to_string(model.shape.tets) + " tets) passed its self-test");
  LoopSettings loop_settings = settings.loop;
  if (settings.mount) loop_settings.mount = corrected_mount(model.mount, *settings.mount);
  const std::optional<SessionInfo> images = source_images(settings, model);
  complete_from_source(settings, images, loop_settings);
  FrameLoop loop(model, images ? std::optional(images->lens) : std::nullopt, loop_settings);
  const OpenSource source = open_source(settings, images);
  const ZeroBasis basis{model.checksum, poses_of(loop_settings.mount.value_or(model.mount))};
  if (!arguments.check) take_imported(settings, basis);
  const LoadedState saved = load_state_or_factory(settings.saved_state, &basis, settings.loop.runtime);
  if (!saved.problem.empty()) {
    log_message(saved.problem);
    loop.set_lasting_fault(FaultCode::kSavedSettings);
  }
  check_realtime(settings.realtime);
  if (arguments.check) {
    if (settings.gpio && has_gpio()) check_gpio(*settings.gpio);
    if (settings.gpio && !has_gpio()) log_message("gpio: not checked, this build has no libgpiod 2");
    return kDone;
  }
  std::optional<StateSaver> saver;
  if (!settings.saved_state.empty()) saver.emplace(settings.saved_state, basis);
  std::optional<Recorder> recorder;
  if (!settings.recordings.empty() && images) {
    recorder.emplace(settings.recordings, *images, Recorder::Limits{settings.record_max_s, settings.record_reserve_mb});
  }
  std::optional<PagePublisher> page;
  if (settings.page) open_page(settings, model, images, loop_settings.mount.value_or(model.mount), page);
  DigitalOutputs outputs(settings.gpio);
  Control control(settings.write_key, settings.loop.runtime, saved.state.settings);
  const int timeout_ms = frame_timeout_ms(settings);
  Commands commands(control, loop, saver ? &*saver : nullptr, recorder ? &*recorder : nullptr, saved.state,
                    kNsPerMs * timeout_ms);
  control.identify(identity_of(settings, &model));
  if (reset) control.remember(*reset);
  control.expect_gravity(kNsPerMs * settings.gravity_max_age_ms);
  const Thermometer thermometer(control);
  Health health(control);
  ModbusServer server(settings.modbus, control, log_message);
  log_message("Modbus TCP on " + settings.modbus.address + ":" + std::to_string(server.port()));
  RegisterLog log(arguments.registers);
  make_realtime(settings.realtime);
  const Device device{
      source, loop, commands, server, outputs, log, health, recorder ? &*recorder : nullptr, page ? &*page : nullptr};
  if (!run_loop(device, timeout_ms, stop_requested)) {
    throw std::runtime_error("gpio: the outputs can no longer be set");
  }
  if (const auto left_out = log.write()) {
    log_message(arguments.registers + ": " + std::to_string(left_out) + " later blocks had no room");
  }
  const SourceStatus& status = status_of(source);
  const CameraCounts counts = status.counts();
  std::fprintf(stderr, "%sframes %u, dropped %u, late %u, broken %u; camera lost %u times\n",
               loop.times().table().c_str(), loop.state().frames, loop.state().dropped_frames, counts.late,
               counts.broken, counts.losses);
  if (commands.reset_is_ordered() && !stop_requested) {
    log_message("a client ordered a reset");
    reset = control.last_finished();
    return kStartAgain;
  }
  if (!status.ended() || status.error().empty()) return kDone;
  log_message(status.error());
  return kInputRefused;
}

/// The fault that safe mode serves after the firmware ended with this exit code.
FaultCode fault_after(const std::string& exit_code) {
  if (exit_code == std::to_string(kInputRefused)) return FaultCode::kSettingsRefused;
  return exit_code == std::to_string(kSelfTestFailed) ? FaultCode::kSelfTest : FaultCode::kFailedRepeatedly;
}

int start(const Arguments& arguments, std::optional<GivenCommand>& reset) {
  const SettingsFiles files(arguments.settings, arguments.user);
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
    const DigitalOutputs safe(read_usable_settings(files).gpio);  // takes the lines at their safe levels
    return 0;
  }
  return measure(arguments, read_settings(files), reset);
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
    std::optional<GivenCommand> reset;
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
