// finsightd: settings -> model -> self-test -> loop. The only catch-all of the firmware.
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include "firmware/frame_loop.h"
#include "firmware/input_error.h"
#include "firmware/self_test.h"
#include "firmware/settings.h"

namespace {

using namespace finsight;

constexpr const char* kUsage =
    "finsightd: a soft finger's camera in, touch on Modbus registers out.\n"
    "\n"
    "usage: finsightd --settings FILE [--registers CSV] [--check]\n"
    "  --settings FILE   board file (TOML); boards/replay/board.toml is one with every key explained\n"
    "  --registers CSV   at the end, write every published register block to this file\n"
    "  --check           read settings and model, run the self-test, and stop\n"
    "  --help, --version\n"
    "\n"
    "Stops on SIGINT and SIGTERM, or at the end of a recording that does not repeat.\n"
    "exit codes: 0 done, 1 failed at work (port in use, camera lost), 2 bad settings, model or recording\n";

std::atomic<bool> stop_requested{false};

struct Arguments {
  std::string settings, registers;
  bool check = false;
};

std::optional<Arguments> parse(int argc, char** argv) {
  Arguments arguments;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--settings" && i + 1 < argc) {
      arguments.settings = argv[++i];
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
  constexpr int kFrameTimeoutMs = 100;  // six frame times at 60 frames/s: the camera has stalled
  while (!stop_requested) {
    Frame frame;
    if (camera.next(frame, kFrameTimeoutMs)) {
      const RegisterImage& image = loop.step(frame);
      server.publish(image);
      log.add(image);
    } else if (camera.ended()) {
      break;
    } else {
      server.publish(loop.step_without_frame(steady_now_ns()));
    }
  }
}

int start(const Arguments& arguments) {
  const Settings settings = read_settings(arguments.settings);
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
  run(*camera, loop, server, log);
  log.write();
  std::fprintf(stderr, "%s", loop.times().table().c_str());
  if (camera->error().empty()) return 0;
  std::fprintf(stderr, "finsightd: %s\n", camera->error().c_str());
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
    return start(*arguments);
  } catch (const InputError& error) {
    std::fprintf(stderr, "finsightd: %s\n", error.what());
    return 2;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "finsightd: %s\n", error.what());
    return 1;
  }
}
