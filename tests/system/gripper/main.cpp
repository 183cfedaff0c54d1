// Gripper in the loop: finger, object and drives are simulated; between them and the controllers are finsightd's own
// frame loop and Modbus server. The controllers see nothing but registers and command nothing but positions.
//
// usage: gripper_loop PACK SPEC.toml STATES.safetensors OBJECTS.csv [--runs N] [--seed N] [--plots FOLDER]
// exit code: 0 if at least 95 of 100 runs of each controller succeed, 1 if not, 2 for wrong usage
#include <modbus.h>

#include <cstdio>
#include <cstring>
#include <fstream>
#include <memory>
#include <string>

#include "firmware/device/commands.h"
#include "firmware/modbus/server.h"
#include "hostgen/learn/touch_samples.h"
#include "tests/system/gripper/world.h"

using namespace finsight;
using namespace finsight::host;

namespace gripper {

namespace {

using Noise = std::array<PoseNoise, kPlates>;

constexpr double kCycle_s = 1.0 / 60;

/// The device: plate poses in, registers out through a real TCP connection, by libmodbus as the client.
class Device {
 public:
  /// `noise` is that of plate motions measured by a camera, as the finger's spec states it.
  Device(const Model& model, const Noise& noise)
      : noise_(noise),
        loop_(model, std::nullopt, {.shape = {.tier = ShapeSettings::Tier::kMap}, .runtime = {}}),
        commands_(control_, loop_, nullptr, nullptr, {}),
        server_({.port = 0}, control_),
        client_(modbus_new_tcp("127.0.0.1", server_.port()), &modbus_free) {
    modbus_set_response_timeout(client_.get(), 10, 0);  // what the machine does besides is not what is tested
    if (modbus_connect(client_.get()) != 0) throw std::runtime_error("cannot connect to the server");
  }

  void frame(PoseVector numbers, Random& random) {
    add_noise(noise_, random, numbers);
    const PlatePoses poses = seen_poses({numbers.data(), kPoseDims});
    commands_.poll();
    server_.publish(loop_.step(Observation{.exposure_ns = steady_now_ns(), .sequence = ++sequence_, .poses = poses}));
  }

  Inputs read() {
    std::uint16_t w[48];
    if (modbus_read_registers(client_.get(), 0, 48, w) != 48) throw std::runtime_error("a read failed");
    const auto length = [](std::uint16_t word) { return static_cast<float>(static_cast<std::int16_t>(word)) / 100; };
    Inputs in;
    in.alive = w[2] != std::exchange(heartbeat_, w[2]);
    in.any_fault = w[0] & kAnyFault;
    in.touch_valid = w[0] & kTouchValid;
    in.gentle = w[44] & bit_named("limits", "gentle");
    in.overload = w[0] & kOverload;
    in.level_valid = w[11] != 65535;
    in.level_permille = w[11];
    in.touch_x_mm = length(w[5]);
    in.touch_y_mm = length(w[6]);
    in.touch_uncertainty_mm = static_cast<float>(w[8]) / 100;
    return in;
  }

  /// Writes the recipe: both thresholds in one request, after the key.
  void set_gentle(int on, int off) {
    const std::uint16_t pair[] = {static_cast<std::uint16_t>(on), static_cast<std::uint16_t>(off)};
    if (modbus_write_register(client_.get(), kKeyRegister, kDefaultWriteKey) != 1 ||
        modbus_write_registers(client_.get(), address_of("gentle_on"), 2, pair) != 2) {
      throw std::runtime_error("the settings were refused");
    }
  }

 private:
  Noise noise_;
  FrameLoop loop_;
  Control control_;
  Commands commands_;
  ModbusServer server_;
  std::unique_ptr<modbus_t, decltype(&modbus_free)> client_;
  std::uint32_t sequence_ = 0;
  std::uint16_t heartbeat_ = 0;
};

/// One line per cycle, for plots.
class Trace {
 public:
  explicit Trace(const std::string& file) {
    if (!file.empty()) out_.open(file);
    if (out_.is_open()) out_ << "# s, true x mm, true y mm, read x mm, read y mm, true N, level permille, opening mm\n";
  }
  void add(double time_s, const World& world, const Inputs& in, double opening_mm) {
    if (!out_.is_open()) return;
    const float none = std::nanf("");
    out_ << time_s << " " << world.touch_x_mm << " " << world.touch_y_mm << " "
         << (in.touch_valid ? in.touch_x_mm : none) << " " << (in.touch_valid ? in.touch_y_mm : none) << " "
         << world.force_n << " " << in.level_permille << " " << opening_mm << "\n";
  }

 private:
  std::ofstream out_;
};

/// Runs cycles of drives, world, device and PLC until the controller has ended or the time is over.
template <class Controller, class Until>
void play(Controller& plc, World& world, Device& device, Random& random, Trace& trace, double seconds, Until ended) {
  Drive jaws(plc.out.opening_mm, 20), arm_x(0, 100), arm_y(0, 100);
  for (double time_s = 0; time_s < seconds && !ended(time_s); time_s += kCycle_s) {
    jaws.advance(plc.out.opening_mm, kCycle_s);
    arm_x.advance(plc.out.arm_x_mm, kCycle_s);
    arm_y.advance(plc.out.arm_y_mm, kCycle_s);
    world.advance(jaws.at_mm(), arm_x.at_mm(), arm_y.at_mm(), kCycle_s);
    device.frame(world.plates, random);
    Inputs in = device.read();
    in.in_position = jaws.reached() && arm_x.reached() && arm_y.reached();
    plc.cycle(in);
    trace.add(time_s, world, in, jaws.at_mm());
  }
}

std::string trace_file(const std::string& plots, const std::string& name, int run) {
  return plots.empty() || run > 0 ? "" : plots + "/" + name + ".dat";
}

int regrasp_runs(const StateInterpolant& finger, const Model& model, const Noise& noise, int runs, std::uint64_t seed,
                 const std::string& plots) {
  int good = 0, moves = 0;
  double sum_mm = 0, worst_mm = 0;
  for (int run = 0; run < runs; ++run) {
    Random random(seed + static_cast<std::uint64_t>(run));
    const Object object{"block", 20 + 60 * random.uniform(), 0.5 * std::pow(400, random.uniform())};
    World world(finger, object, -12 + 24 * random.uniform(), 20 + 85 * random.uniform());
    Device device(model, noise);
    Regrasp plc;
    plc.out.opening_mm = static_cast<float>(object.size_mm) + 3;
    Trace trace(trace_file(plots, "regrasp", run));
    play(plc, world, device, random, trace, 60, [&](double) { return plc.out.done || plc.out.error; });
    const double off_mm = std::hypot(world.touch_x_mm - plc.kCentre_x_mm, world.touch_y_mm - plc.kCentre_y_mm);
    const bool is_good = plc.out.done && off_mm <= 5;
    good += is_good;
    moves += plc.moves;
    sum_mm += off_mm;
    worst_mm = std::max(worst_mm, off_mm);
    if (!is_good)
      std::printf("regrasp run %d: %s, %.1f mm off, %d moves\n", run, plc.out.done ? "done" : "not done", off_mm,
                  plc.moves);
  }
  std::printf(
      "regrasp: %d of %d runs within 5 mm in at most 5 moves; %.1f moves, %.1f mm off on average, worst %.1f mm\n",
      good, runs, double(moves) / runs, sum_mm / runs, worst_mm);
  return good;
}

/// An object, and the deformation level that holds it without crushing it, found by closing on one sample of it.
struct Recipe {
  Object object;
  int level_permille = 0;
};

/// Throws std::runtime_error.
std::vector<Recipe> read_recipes(const std::string& csv) {
  std::ifstream in(csv);
  std::vector<Recipe> recipes;
  std::string line;
  for (std::getline(in, line); std::getline(in, line);) {
    Recipe r;
    const auto comma = line.find(',');
    r.object.name = line.substr(0, comma);
    if (comma == std::string::npos ||
        std::sscanf(line.c_str() + comma, ",%lf,%lf,%lf,%lf,%lf,%d", &r.object.size_mm, &r.object.stiffness_n_per_mm,
                    &r.object.holds_from_n, &r.object.breaks_at_n, &r.object.creep, &r.level_permille) != 6) {
      throw std::runtime_error(csv + ": expected a name and six numbers, found '" + line + "'");
    }
    recipes.push_back(r);
  }
  if (recipes.empty()) throw std::runtime_error(csv + ": no objects");
  return recipes;
}

int gentle_runs(const StateInterpolant& finger, const Model& model, const Noise& noise,
                const std::vector<Recipe>& recipes, int runs, std::uint64_t seed, const std::string& plots) {
  constexpr double kSeconds = 20;
  int good = 0;
  for (int run = 0; run < runs; ++run) {
    Random random(seed + 1000 + static_cast<std::uint64_t>(run));
    const Recipe& recipe = recipes[static_cast<std::size_t>(run) % recipes.size()];
    Object object = recipe.object;
    object.size_mm *= 0.85 + 0.3 * random.uniform();
    object.stiffness_n_per_mm *= 0.7 + 0.6 * random.uniform();
    World world(finger, object, -4 + 8 * random.uniform(), 55 + 10 * random.uniform());
    Device device(model, noise);
    device.set_gentle(recipe.level_permille, recipe.level_permille * 9 / 10);
    GentleGrasp plc(static_cast<float>(recipe.level_permille));
    plc.out.opening_mm = static_cast<float>(object.size_mm) + 4;
    const bool is_shown = run < static_cast<int>(recipes.size());
    Trace trace(is_shown ? trace_file(plots, "gentle-" + object.name, 0) : "");
    play(plc, world, device, random, trace, kSeconds, [](double) { return false; });
    const bool holds = world.force_n >= object.holds_from_n && world.slipped_n == 0;
    const bool is_good = plc.out.done && holds && !world.is_broken();
    good += is_good;
    if (!is_good || is_shown) {
      std::printf("gentle run %d, %s: %s; at most %.2f N (breaks at %.2f), %.2f N at the end (held from %.2f)\n", run,
                  object.name.c_str(), is_good ? "held, not crushed" : "FAILED", world.largest_n, object.breaks_at_n,
                  world.force_n, object.holds_from_n);
    }
  }
  std::printf("gentle: %d of %d runs held and not crushed for %.0f s\n", good, runs, kSeconds);
  return good;
}

}  // namespace
}  // namespace gripper

int main(int argc, char** argv) {
  int runs = 100;
  std::uint64_t seed = 1;
  std::string plots;
  for (int i = 5; i + 1 < argc; i += 2) {
    if (!std::strcmp(argv[i], "--runs")) runs = std::atoi(argv[i + 1]);
    if (!std::strcmp(argv[i], "--seed")) seed = static_cast<std::uint64_t>(std::atoll(argv[i + 1]));
    if (!std::strcmp(argv[i], "--plots")) plots = argv[i + 1];
  }
  if (argc < 5 || runs < 1) {
    std::fputs(
        "usage: gripper_loop PACK SPEC.toml STATES.safetensors OBJECTS.csv [--runs N] [--seed N] [--plots FOLDER]\n",
        stderr);
    return 2;
  }
  try {
    const Model model = Model::open(argv[1]);
    const gripper::Noise noise = read_finger_spec(argv[2]).noise;
    const StateInterpolant finger(read_dataset(argv[3]).states);
    const std::vector<gripper::Recipe> recipes = gripper::read_recipes(argv[4]);
    const int regrasped = gripper::regrasp_runs(finger, model, noise, runs, seed, plots);
    const int held = gripper::gentle_runs(finger, model, noise, recipes, runs, seed, plots);
    return std::min(regrasped, held) * 100 >= 95 * runs ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "gripper_loop: %s\n", error.what());
    return 2;
  }
}
