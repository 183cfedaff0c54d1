// finsightd: settings -> model -> self-test -> loop. The only catch-all of the firmware.
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "firmware/device/commands.h"
#include "firmware/device/network_file.h"
#include "firmware/device/outputs.h"
#include "firmware/device/realtime.h"
#include "firmware/device/supervisor.h"
#include "firmware/input_error.h"
#include "firmware/loop/frame_loop.h"
#include "firmware/loop/self_test.h"
#include "firmware/settings/settings.h"

namespace {

using namespace finsight;

constexpr const char* kUsage =
    "finsightd: a soft finger's camera in, touch on Modbus registers out.\n"
    "\n"
    "usage: finsightd --settings FILE [--user FILE] [--registers CSV | --check | --safe-outputs | ...]\n"
    "  --settings FILE   board file (TOML); boards/replay/board.toml is one with every key explained\n"
    "  --user FILE       its values take the place of the board file's\n"
    "  --registers CSV   at the end, write every published register block to this file\n"
    "  --check           read settings and model, run the self-test, and stop\n"
    "  --safe-outputs    set the digital outputs to their safe levels, and stop: for after a crash\n"
    "  --network FILE    write the [network] section for systemd-networkd to this file, and stop\n"
    "  --safe-mode CODE  only serve a fault: that the firmware ended again and again with this exit code\n"
    "  --help, --version\n"
    "\n"
    "Stops on SIGINT and SIGTERM, or at the end of a recording that does not repeat.\n"
    "exit codes: 0 done, 1 failed at work (port in use, camera lost), 2 bad settings, model or recording\n";

std::atomic<bool> stop_requested{false};

struct Arguments {
  std::string settings, user, registers, network, safe_mode;
  bool check = false, safe_outputs = false;
};

std::optional<Arguments> parse(int argc, char** argv) {
  Arguments arguments;
  const std::pair<const char*, std::string*> valued[] = {{"--settings", &arguments.settings},
                                                         {"--user", &arguments.user},
                                                         {"--registers", &arguments.registers},
                                                         {"--network", &arguments.network},
                                                         {"--safe-mode", &arguments.safe_mode}};
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const auto option = std::find_if(std::begin(valued), std::end(valued), [&](auto& v) { return word == v.first; });
    if (option != std::end(valued) && i + 1 < argc && *argv[i + 1]) {
      *option->second = argv[++i];
    } else if (word == "--check") {
      arguments.check = true;
    } else if (word == "--safe-outputs") {
      arguments.safe_outputs = true;
    } else {
      return std::nullopt;
    }
  }
  return arguments.settings.empty() ? std::nullopt : std::optional(arguments);
}

void log_message(const std::string& news) { std::fprintf(stderr, "finsightd: %s\n", news.c_str()); }

/// What the images are seen through; nothing where there are none.
std::optional<CameraModel> lens_of(const Settings& settings, const Model& model) {
  if (settings.source == Settings::Source::kCamera) return settings.lens;
  if (settings.source == Settings::Source::kPoses) return std::nullopt;
  const SessionInfo info = read_session_info(settings.replay.path);
  const std::string file = (settings.replay.path / kSessionInfo).string();
  if (info.marker_id != model.mount.marker_id) throw InputError(file, "marker ids are not those of the model pack");
  const auto size_mm = static_cast<double>(model.mount.marker_size_mm);
  if (std::abs(info.marker_size_mm - size_mm) > 0.001 * size_mm) {
    throw InputError(file, "markers.size_mm", std::to_string(info.marker_size_mm),
                     std::to_string(size_mm) + ", as in the model pack");
  }
  return camera_of(info);
}

std::unique_ptr<Camera> open_camera(const Settings& settings) {
  switch (settings.source) {
    case Settings::Source::kSession:
      return open_session_camera(settings.replay);
    case Settings::Source::kPoses:
      return open_pose_camera(settings.replay);
    case Settings::Source::kCamera:
      break;
  }
  return open_live_camera(settings.camera, log_message);
}

/// What a recording holds beside its images; nothing where there are none.
std::optional<SessionInfo> recording_info(const Settings& settings, const Model& model) {
  if (settings.source == Settings::Source::kPoses) return std::nullopt;
  if (settings.source == Settings::Source::kSession) return read_session_info(settings.replay.path);
  const CameraModel& lens = settings.lens;
  SessionInfo info;
  info.width_px = settings.camera.width_px;
  info.height_px = settings.camera.height_px;
  info.frames_per_second = settings.camera.frames_per_second;
  info.fx_fy_cx_cy = {lens.fx, lens.fy, lens.cx, lens.cy};
  info.k1_k2_p1_p2_k3 = {lens.k1, lens.k2, lens.p1, lens.p2, lens.k3};
  info.marker_dictionary = "DICT_4X4_50";
  info.marker_id = model.mount.marker_id;
  info.marker_size_mm = static_cast<double>(model.mount.marker_size_mm);
  return info;
}

/// What clients saved. If that cannot be used, the factory settings, and a fault until a client says that it knows.
/// `loop`: shows the fault if they are refused; none in safe mode.
SavedState load_saved(const Settings& settings, FrameLoop* loop) {
  const SavedState factory{settings.loop.runtime, std::nullopt};
  if (settings.saved_state.empty()) return factory;
  try {
    return load_state(settings.saved_state).value_or(factory);
  } catch (const InputError& error) {
    log_message(std::string(error.what()) + "; the factory settings are used");
    if (loop) loop->set_lasting_fault(FaultCode::kSavedSettings);
    return factory;
  }
}

/// The digital outputs, if the board has any: safe until the first frame, on faults, at exit, and when we crash.
class Outputs {
 public:
  explicit Outputs(const std::optional<GpioSettings>& settings) {
    if (!settings) return;
    safe_ = safe_levels(*settings);
    filter_.emplace(safe_);
    gpio_ = open_gpio(*settings);
    in_use_ = this;
    for (const int fault : {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL}) std::signal(fault, on_crash);
  }
  ~Outputs() { in_use_ = nullptr; }
  Outputs(const Outputs&) = delete;
  Outputs& operator=(const Outputs&) = delete;

  bool set(const RegisterImage& image, const RuntimeSettings& settings) {
    return !gpio_ || gpio_->set(filter_->next(image.words[0], settings, steady_now_ns()));
  }
  bool trigger_rises() { return gpio_ && trigger_.rises(gpio_->trigger()); }

 private:
  static void on_crash(int signal) {
    if (in_use_) in_use_->gpio_->set(in_use_->safe_);
    std::signal(signal, SIG_DFL);
    std::raise(signal);
  }
  static inline Outputs* in_use_ = nullptr;
  OutputLevels safe_{};
  std::optional<OutputFilter> filter_;
  TriggerInput trigger_;
  std::unique_ptr<Gpio> gpio_;
};

/// Keeps every published block in memory and writes them when the loop is over.
class RegisterLog {
 public:
  explicit RegisterLog(std::string file) : file_(std::move(file)) {}
  void add(const RegisterImage& image) {
    if (!file_.empty()) blocks_.push_back(image.words);
  }
  void write() const {
    if (file_.empty()) return;
    std::ofstream out(file_);
    for (int i = 0; i < kMeasurementRegisters; ++i) out << (i ? "," : "") << "r" << i;
    out << "\n";
    for (const auto& words : blocks_) {
      for (std::size_t i = 0; i < words.size(); ++i) out << (i ? "," : "") << words[i];
      out << "\n";
    }
    out.flush();
    if (!out) throw std::runtime_error(file_ + ": cannot be written");
  }

 private:
  std::string file_;
  std::vector<std::array<std::uint16_t, kMeasurementRegisters>> blocks_;
};

/// Without a frame for so long, clients hear of a fault: six frame times at 60 frames/s, three at slow cameras.
int frame_timeout_ms(const Settings& settings) {
  const bool is_live = settings.source == Settings::Source::kCamera;
  return std::max(100, is_live ? static_cast<int>(3000 / settings.camera.frames_per_second) : 0);
}

/// What works together while frames come.
struct Device {
  Camera& camera;
  FrameLoop& loop;
  Commands& commands;
  ModbusServer& server;
  Outputs& outputs;
  RegisterLog& log;
  Recorder* recorder;  ///< may be null
};

/// Frames in, registers and outputs out, until the recording ends, a signal comes, or a client orders a reset. False:
/// the outputs failed.
bool run(Device device, int timeout_ms) {
  Supervisor supervisor;
  supervisor.ready();
  std::uint32_t openings = 0;
  while (!stop_requested && !device.commands.reset_is_due()) {
    Frame frame;
    const bool has_frame = device.camera.next(frame, timeout_ms);
    if (!has_frame && device.camera.ended()) break;
    device.commands.poll();
    if (device.outputs.trigger_rises()) device.commands.trigger();
    const std::int64_t now_ns = steady_now_ns();
    const RegisterImage& image = has_frame ? device.loop.step(frame) : device.loop.step_without_frame(now_ns);
    device.server.publish(image);
    // A camera that is missing is looked for; a restart would not bring it, only cut the clients off.
    const std::uint32_t before = std::exchange(openings, device.camera.counts().openings);
    if (has_frame || openings != before) supervisor.alive(now_ns, has_frame);
    if (!device.outputs.set(image, device.loop.state().settings)) return false;
    if (!has_frame) continue;
    device.log.add(image);
    if (device.recorder) device.recorder->add(frame, image);
  }
  return true;
}

/// As the settings want it; where that is not possible, where a client looks first.
std::unique_ptr<ModbusServer> open_server_with_fallback(const ModbusSettings& settings, Control& control) {
  try {
    return std::make_unique<ModbusServer>(settings, control, log_message);
  } catch (const std::system_error& error) {
    log_message(error.what());
    return std::make_unique<ModbusServer>(ModbusSettings{.address = "0.0.0.0", .port = 502}, control);
  }
}

/// What start() returns when it is to be called again.
constexpr int kStartAgain = -1;

/// The firmware cannot work: clients see why. Needs no model and no camera, and settings only as far as they are good.
/// Of the commands only reset is carried out; it ends safe mode by ending the program.
int run_safe_mode(const Arguments& arguments) {
  LoopState state;
  state.fault = arguments.safe_mode == "2" ? FaultCode::kSettingsRefused : FaultCode::kFailedRepeatedly;
  const Settings settings = read_good_parts(arguments.settings, arguments.user);
  std::optional<Outputs> outputs;  // stay safe from their opening on
  try {
    outputs.emplace(settings.gpio);
    read_settings(arguments.settings, arguments.user);
  } catch (const std::exception& error) {
    log_message(error.what());
  }
  Control control(settings.write_key, settings.loop.runtime, load_saved(settings, nullptr).settings);
  const auto server = open_server_with_fallback(settings.modbus, control);
  log_message("SAFE MODE, fault " + std::to_string(static_cast<int>(state.fault)) + "; Modbus TCP on port " +
              std::to_string(server->port()));
  Supervisor().ready();
  RegisterImage image;
  while (!stop_requested) {
    ++state.heartbeat;
    state.settings = control.settings();
    encode_registers(PlatePoses{}, FingerShape{}, Touch{}, state, image);
    server->publish(image);
    if (const auto command = control.take_command()) {
      control.finish(*command == Command::kReset ? CommandResult::kDone : CommandResult::kNotPossible);
      if (*command == Command::kReset) {
        std::this_thread::sleep_for(std::chrono::nanoseconds(kResultIsShownNs));
        return 1;
      }
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  return 0;
}

int write_network(const Arguments& arguments) {
  const std::string text = networkd_file(read_network_settings(arguments.settings, arguments.user));
  std::ofstream out(arguments.network);
  out << text;
  out.flush();
  if (!out) throw std::runtime_error(arguments.network + ": cannot be written");
  return 0;
}

int start(const Arguments& arguments) {
  if (!arguments.safe_mode.empty()) return run_safe_mode(arguments);
  if (!arguments.network.empty()) return write_network(arguments);
  if (arguments.safe_outputs) {
    const Outputs outputs(read_good_parts(arguments.settings, arguments.user).gpio);  // takes the lines at safe levels
    return 0;
  }
  const Settings settings = read_settings(arguments.settings, arguments.user);
  const Model model = Model::open(settings.pack);
  check_self_test(model);
  std::fprintf(stderr, "finsightd: model %s (%d tets) passed its self-test\n", model.finger_name.c_str(),
               model.shape.tets);
  LoopSettings loop_settings = settings.loop;
  if (settings.mount) loop_settings.mount = corrected_mount(model.mount, *settings.mount);
  FrameLoop loop(model, lens_of(settings, model), loop_settings);
  const auto camera = open_camera(settings);
  const SavedState saved = load_saved(settings, &loop);
  if (arguments.check) return 0;
  std::optional<StateSaver> saver;
  if (!settings.saved_state.empty()) saver.emplace(settings.saved_state);
  std::optional<Recorder> recorder;
  const auto images = recording_info(settings, model);
  if (!settings.recordings.empty() && images) recorder.emplace(settings.recordings, *images);
  Outputs outputs(settings.gpio);
  Control control(settings.write_key, settings.loop.runtime, saved.settings);
  Commands commands(control, loop, saver ? &*saver : nullptr, recorder ? &*recorder : nullptr, saved,
                    std::int64_t{1'000'000} * frame_timeout_ms(settings));
  ModbusServer server(settings.modbus, control, log_message);
  std::fprintf(stderr, "finsightd: Modbus TCP on %s:%d\n", settings.modbus.address.c_str(), server.port());
  RegisterLog log(arguments.registers);
  make_realtime(settings.realtime);
  const Device device{*camera, loop, commands, server, outputs, log, recorder ? &*recorder : nullptr};
  if (!run(device, frame_timeout_ms(settings))) throw std::runtime_error("gpio: the outputs cannot be set any more");
  log.write();
  const CameraCounts counts = camera->counts();
  std::fprintf(stderr, "%sframes %u, dropped %u, late %u; camera lost %u times\n", loop.times().table().c_str(),
               loop.state().frames, loop.state().dropped_frames, counts.late, counts.losses);
  if (commands.reset_is_ordered() && !stop_requested) {
    log_message("a client ordered a reset");
    return kStartAgain;
  }
  if (!camera->ended() || camera->error().empty()) return 0;
  log_message(camera->error());
  return 2;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc == 2 && std::strcmp(argv[1], "--help") == 0) return std::fputs(kUsage, stdout) < 0;
  if (argc == 2 && std::strcmp(argv[1], "--version") == 0) return std::puts("finsightd " FINSIGHT_VERSION) < 0;
  const std::optional<Arguments> arguments = parse(argc, argv);
  if (!arguments) {
    std::fputs(kUsage, stderr);
    return 2;
  }
  const auto request_stop = [](int) { stop_requested = true; };
  std::signal(SIGINT, request_stop);
  std::signal(SIGTERM, request_stop);
  try {
    const SchedulingSnapshot before;
    for (;;) {
      const int code = start(*arguments);
      if (code != kStartAgain) return code;
      before.restore();
    }
  } catch (const InputError& error) {
    log_message(error.what());
    return 2;
  } catch (const std::exception& error) {
    log_message(error.what());
    return 1;
  }
}
