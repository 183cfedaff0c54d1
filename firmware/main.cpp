// finsightd: settings -> model -> self-test -> loop. The only catch-all of the firmware.
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "firmware/appliance.h"
#include "firmware/frame_loop.h"
#include "firmware/input_error.h"
#include "firmware/self_test.h"
#include "firmware/settings.h"

namespace {

using namespace finsight;

constexpr const char* kUsage =
    "finsightd: a soft finger's camera in, touch on Modbus registers out.\n"
    "\n"
    "usage: finsightd --settings FILE [--user FILE] [--registers CSV]\n"
    "  --settings FILE   board file (TOML); boards/replay/board.toml is one with every key explained\n"
    "  --user FILE       its values take the place of the board file's\n"
    "  --registers CSV   at the end, write every published register block to this file\n"
    "  --check           read settings and model, run the self-test, and stop\n"
    "  --network FILE    write the [network] section for systemd-networkd to this file, and stop\n"
    "  --safe-mode CODE  only serve a fault: that the firmware ended again and again with this exit code\n"
    "  --help, --version\n"
    "\n"
    "Stops on SIGINT and SIGTERM, or at the end of a recording that does not repeat.\n"
    "exit codes: 0 done, 1 failed at work (port in use, camera lost), 2 bad settings, model or recording\n";

std::atomic<bool> stop_requested{false};

struct Arguments {
  std::string settings, user, registers, network;
  std::optional<std::string> safe_mode;
  bool check = false;
};

std::optional<Arguments> parse(int argc, char** argv) {
  Arguments arguments;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--settings" && i + 1 < argc) {
      arguments.settings = argv[++i];
    } else if (word == "--user" && i + 1 < argc) {
      arguments.user = argv[++i];
    } else if (word == "--network" && i + 1 < argc) {
      arguments.network = argv[++i];
    } else if (word == "--safe-mode" && i + 1 < argc) {
      arguments.safe_mode = argv[++i];
    } else if (word == "--registers" && i + 1 < argc) {
      arguments.registers = argv[++i];
    } else if (word == "--check") {
      arguments.check = true;
    } else {
      return std::nullopt;
    }
  }
  return arguments.settings.empty() ? std::nullopt : std::optional(arguments);
}

std::optional<CameraModel> session_camera(const Settings& settings, const Model& model) {
  if (settings.source != Settings::Source::kSession) return std::nullopt;
  const SessionInfo info = read_session_info(settings.replay.path);
  if (info.marker_id != model.mount.marker_id) {
    throw InputError((settings.replay.path / "session.toml").string(), "marker ids are not those of the model pack");
  }
  return camera_of(info);
}

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

/// Frames in, registers out, until the recording ends or a signal comes.
void run(Camera& camera, FrameLoop& loop, ModbusServer& server, RegisterLog& log) {
  Supervisor supervisor;
  supervisor.ready();
  constexpr int kFrameTimeoutMs = 100;  // six frame times at 60 frames/s: the camera has stalled
  while (!stop_requested) {
    Frame frame;
    if (camera.next(frame, kFrameTimeoutMs)) {
      const RegisterImage& image = loop.step(frame);
      server.publish(image);
      supervisor.alive(steady_now_ns());
      log.add(image);
    } else if (camera.ended()) {
      break;
    } else {
      server.publish(loop.step_without_frame(steady_now_ns()));
    }
  }
}

/// The firmware cannot work: clients see why. Needs no model and no camera, and settings only as far as they are good.
int serve_fault(const Arguments& arguments) {
  ModbusSettings modbus{.address = "0.0.0.0", .port = 502};
  LoopState state;
  state.fault = *arguments.safe_mode == "2" ? FaultCode::kSettingsRefused : FaultCode::kFailedRepeatedly;
  try {
    const Settings settings = read_settings(arguments.settings, arguments.user);
    modbus = settings.modbus;
    state.word_order = settings.loop.word_order;
  } catch (const InputError& error) {
    std::fprintf(stderr, "finsightd: %s\n", error.what());
  }
  ModbusServer server(modbus);
  std::fprintf(stderr, "finsightd: SAFE MODE, fault %d; Modbus TCP on %s:%d\n", static_cast<int>(state.fault),
               modbus.address.c_str(), server.port());
  Supervisor().ready();
  RegisterImage image;
  while (!stop_requested) {
    ++state.heartbeat;
    encode_registers(PlatePoses{}, FingerShape{}, Touch{}, state, image);
    server.publish(image);
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  return 0;
}

int write_network(const Arguments& arguments) {
  const std::string text = networkd_file(read_settings(arguments.settings, arguments.user).network);
  std::ofstream out(arguments.network);
  out << text;
  out.flush();
  if (!out) throw std::runtime_error(arguments.network + ": cannot be written");
  return 0;
}

int start(const Arguments& arguments) {
  if (arguments.safe_mode) return serve_fault(arguments);
  if (!arguments.network.empty()) return write_network(arguments);
  const Settings settings = read_settings(arguments.settings, arguments.user);
  const Model model = Model::open(settings.pack);
  check_self_test(model);
  std::fprintf(stderr, "finsightd: model %s (%d tets) passed its self-test\n", model.finger_name.c_str(),
               model.shape.tets);
  FrameLoop loop(model, session_camera(settings, model), settings.loop);
  const auto camera = settings.source == Settings::Source::kSession ? open_session_camera(settings.replay)
                                                                    : open_pose_camera(settings.replay);
  if (arguments.check) return 0;
  ModbusServer server(settings.modbus);
  std::fprintf(stderr, "finsightd: Modbus TCP on %s:%d\n", settings.modbus.address.c_str(), server.port());
  RegisterLog log(arguments.registers);
  make_realtime(settings.realtime);
  run(*camera, loop, server, log);
  log.write();
  std::fprintf(stderr, "%s", loop.times().table().c_str());
  if (!camera->error().empty()) throw InputError(settings.replay.path.string(), camera->error());
  return 0;
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
    return start(*arguments);
  } catch (const InputError& error) {
    std::fprintf(stderr, "finsightd: %s\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "finsightd: %s\n", error.what());
    return 1;
  }
}
