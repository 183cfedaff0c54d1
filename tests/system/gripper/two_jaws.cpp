// A gripper whose jaws are both fingers, with packs of their own, in the loop: fingers, part and drives are simulated;
// between them and the controller are two of finsightd's frame loops and its Modbus server. The controller sees nothing
// but the block that gathers both fingers, and commands nothing but positions: it centres itself on the part by the
// balance of forces and holds it gently.
//
// usage: gripper_two_jaws PACK SPEC.toml STATES PACK SPEC.toml STATES [--runs N] [--seed N]
// exit code: 0 if at least 95 of 100 runs succeed, 1 if not, 2 for wrong usage
#include <modbus.h>

#include <cstdio>
#include <cstring>
#include <memory>

#include "firmware/device/commands.h"
#include "firmware/modbus/server.h"
#include "hostgen/learn/touch_samples.h"
#include "tests/system/gripper/world.h"

using namespace finsight;
using namespace finsight::host;

namespace gripper {

namespace {

constexpr double kCycle_s = 1.0 / 60;

/// Values of the gathered block under the names of FB_FinsightGripper.
struct Gripper {
  bool alive = false, all_ready = false, any_overload = false;
  bool force_valid = false;
  float force_sum_n = 0, force_balance_n = 0;
  float level_1_permille = 0, level_2_permille = 0;
};

/// Closes until a finger bends, even if too little to tell a force, and then slowly; moves the gripper away from the
/// side that pushes harder, and goes on until both push alike and hard enough; then keeps that while the part yields.
class CentreAndHold {
 public:
  static constexpr float kFast_mm = 0.08F, kSlow_mm = 0.02F;            // per cycle, of the opening
  static constexpr float kGain_mm_per_n = 0.03F, kFurthest_mm = 0.15F;  // of the arm, per cycle
  static constexpr float kGain_mm_per_permille = 0.002F, kBent_permille = 15;
  static constexpr float kBalanced_n = 0.3F;
  static constexpr float kClosest_mm = 2;

  float opening_mm = 0, arm_mm = 0;  ///< the arm towards finger 2
  bool done = false, error = false;
  explicit CentreAndHold(float sum_n) : sum_n_(sum_n) {}

  void cycle(const Gripper& in) {
    if (!in.alive || !in.all_ready || error) return;  // stay where we are
    if (!in.force_valid) {                            // over range, or two contacts on one finger
      opening_mm += kFast_mm;
      return;
    }
    const bool is_bent = std::max(in.level_1_permille, in.level_2_permille) > kBent_permille;
    // Finger 1 pushes towards finger 2, so where it pushes harder the gripper moves away from the part on its side.
    // Before either tells a force, the one that bends more pushes harder.
    const float push_mm = in.force_sum_n > 0 ? kGain_mm_per_n * in.force_balance_n
                          : is_bent          ? kGain_mm_per_permille * (in.level_1_permille - in.level_2_permille)
                                             : 0;
    arm_mm -= std::clamp(push_mm, -kFurthest_mm, kFurthest_mm);
    const bool is_balanced = std::abs(in.force_balance_n) < kBalanced_n;
    if (in.force_sum_n < 0.9F * sum_n_ && (is_balanced || in.force_sum_n < 0.5F * sum_n_)) {
      opening_mm -= is_bent ? kSlow_mm : kFast_mm;
    } else if (in.force_sum_n > 1.1F * sum_n_) {
      opening_mm += kSlow_mm;
    } else if (is_balanced) {
      done = true;
    }
    error = opening_mm < kClosest_mm;  // there is no part
  }

 private:
  const float sum_n_;
};

/// A part that stands on a table between the fingers, and what has happened to it.
struct Part {
  double size_mm, stiffness_n_per_mm, friction_n;
  double at_mm;  ///< its middle, towards finger 2
};

/// One finger and its half of the part.
class Jaw {
 public:
  Jaw(const StateInterpolant& finger, double x_mm, double y_mm) : finger_(finger), x_(x_mm), y_(y_mm) {}
  double force_at(double depth_mm, double half_stiffness) const {
    double low = 0, high = depth_mm > 0 ? finger_.highest_force_n(x_, y_) : 0;
    for (int i = 0; i < 30 && high > 0; ++i) {
      const double middle = (low + high) / 2;
      const double yield_mm =
          static_cast<double>(finger_.at(x_, y_, middle).displacement_mm.z()) + middle / half_stiffness;
      (yield_mm < depth_mm ? low : high) = middle;
    }
    return low;
  }
  PoseVector plates(double force_n) const {
    return force_n > 0 ? finger_.at(x_, y_, force_n).numbers : PoseVector(PoseVector::Zero());
  }

 private:
  const StateInterpolant& finger_;
  double x_, y_;
};

struct World {
  Jaw left, right;
  Part part;
  double left_n = 0, right_n = 0, largest_n = 0, pushed_mm = 0;

  void advance(double opening_mm, double arm_mm) {
    const double start_mm = part.at_mm;
    push(opening_mm, arm_mm);
    // What its friction does not hold moves the part until it does.
    for (int i = 0; i < 200 && std::abs(left_n - right_n) > part.friction_n; ++i) {
      part.at_mm += left_n > right_n ? 0.02 : -0.02;
      push(opening_mm, arm_mm);
    }
    pushed_mm += std::abs(part.at_mm - start_mm);
    largest_n = std::max({largest_n, left_n, right_n});
  }

 private:
  void push(double opening_mm, double arm_mm) {
    const double closed_mm = (part.size_mm - opening_mm) / 2, off_mm = arm_mm - part.at_mm;
    left_n = left.force_at(closed_mm + off_mm, 2 * part.stiffness_n_per_mm);
    right_n = right.force_at(closed_mm - off_mm, 2 * part.stiffness_n_per_mm);
  }
};

/// A finger's own loop, commands and settings.
struct Finger {
  Finger(const Model& model, const std::array<PoseNoise, kPlates>& its_noise)
      : noise(its_noise),
        loop(model, std::nullopt, {.shape = {.tier = ShapeSettings::Tier::kMap}, .runtime = {}}),
        commands(control, loop, nullptr, nullptr, {}) {}
  const RegisterImage& frame(PoseVector numbers, Random& random) {
    add_noise(noise, random, numbers);
    const PlatePoses poses = seen_poses({numbers.data(), kPoseDims});
    commands.poll();
    return loop.step(Observation{.exposure_ns = steady_now_ns(), .sequence = ++sequence, .poses = poses});
  }
  const std::array<PoseNoise, kPlates> noise;
  FrameLoop loop;
  Control control;
  Commands commands;
  std::uint32_t sequence = 0;
};

/// The device of both, and a client of libmodbus that reads one block.
class Device {
 public:
  Device(Finger& left, Finger& right)
      : server_({.port = 0}, std::array{&left.control, &right.control}),
        client_(modbus_new_tcp("127.0.0.1", server_.port()), &modbus_free) {
    modbus_set_response_timeout(client_.get(), 10, 0);  // what the machine does besides is not what is tested
    if (modbus_connect(client_.get()) != 0) throw std::runtime_error("cannot connect to the server");
  }
  ModbusServer& server() { return server_; }
  Gripper read() {
    std::array<std::uint16_t, kGatheredRegisters> words;
    if (modbus_read_registers(client_.get(), kGatheredAddress, kGatheredRegisters, words.data()) !=
        kGatheredRegisters) {
      throw std::runtime_error("a read failed");
    }
    const auto at = [&](int address) { return words[static_cast<std::size_t>(address - kGatheredAddress)]; };
    const std::uint16_t state = at(address_of("gripper_state"));
    Gripper in;
    in.alive = at(address_of("finger_1_heartbeat")) != std::exchange(heartbeat_, at(address_of("finger_1_heartbeat")));
    in.all_ready = state & bit_named("gripper_state", "all_ready");
    in.any_overload = state & bit_named("gripper_state", "any_overload");
    in.force_valid = at(address_of("force_balance")) != 0x8000 && at(address_of("force_sum")) != 0xFFFF;
    in.force_sum_n = static_cast<float>(at(address_of("force_sum"))) / 100;
    in.force_balance_n = static_cast<float>(static_cast<std::int16_t>(at(address_of("force_balance")))) / 100;
    in.level_1_permille = at(address_of("finger_1_level"));
    in.level_2_permille = at(address_of("finger_2_level"));
    return in;
  }

 private:
  ModbusServer server_;
  std::unique_ptr<modbus_t, decltype(&modbus_free)> client_;
  std::uint16_t heartbeat_ = 0;
};

/// What a jaw is made of.
struct FingerFiles {
  FingerFiles(const char* pack, const char* spec, const char* states)
      : model(Model::open(pack)), noise(read_finger_spec(spec).noise), finger(read_dataset(states).states) {}
  const Model model;
  const std::array<PoseNoise, kPlates> noise;
  const StateInterpolant finger;
};

constexpr double kTarget_n = 2.5, kHolds_from_n = 1.5, kBreaks_at_n = 4.5;  // of each side
constexpr double kUneven_n = 1, kPushed_mm = 1.5;

int run_all(const FingerFiles& left_files, const FingerFiles& right_files, int runs, std::uint64_t seed) {
  constexpr double kSeconds = 20;
  int good = 0;
  double sum_uneven_n = 0, sum_pushed_mm = 0, sum_off_mm = 0;
  for (int run = 0; run < runs; ++run) {
    Random random(seed + static_cast<std::uint64_t>(run));
    const Part part{.size_mm = 25 + 40 * random.uniform(),
                    .stiffness_n_per_mm = 1.5 * std::pow(20, random.uniform()),
                    .friction_n = 0.8 + 2 * random.uniform(),
                    .at_mm = -6 + 12 * random.uniform()};
    const auto place = [&] { return std::pair(-3 + 6 * random.uniform(), 50 + 20 * random.uniform()); };
    const auto [left_x, left_y] = place();
    const auto [right_x, right_y] = place();
    World world{{left_files.finger, left_x, left_y}, {right_files.finger, right_x, right_y}, part};
    Finger left(left_files.model, left_files.noise), right(right_files.model, right_files.noise);
    Device device(left, right);
    CentreAndHold plc(static_cast<float>(2 * kTarget_n));
    plc.opening_mm = static_cast<float>(part.size_mm) + 16;
    Drive jaws(plc.opening_mm, 20), arm(0, 100);
    bool has_slipped = false;
    for (double time_s = 0; time_s < kSeconds; time_s += kCycle_s) {
      jaws.advance(plc.opening_mm, kCycle_s);
      arm.advance(plc.arm_mm, kCycle_s);
      world.advance(jaws.at_mm(), arm.at_mm());
      device.server().publish(left.frame(world.left.plates(world.left_n), random), 0);
      device.server().publish(right.frame(world.right.plates(world.right_n), random), 1);
      plc.cycle(device.read());
      has_slipped = has_slipped || (plc.done && std::min(world.left_n, world.right_n) < kHolds_from_n);
    }
    const double uneven_n = std::abs(world.left_n - world.right_n), off_mm = std::abs(arm.at_mm() - world.part.at_mm);
    const bool is_good = plc.done && !has_slipped && world.largest_n < kBreaks_at_n && uneven_n < kUneven_n &&
                         world.pushed_mm < kPushed_mm;
    good += is_good;
    sum_uneven_n += uneven_n;
    sum_pushed_mm += world.pushed_mm;
    sum_off_mm += off_mm;
    if (!is_good) {
      std::printf("two jaws run %d: %s; %.2f and %.2f N, at most %.2f N; pushed %.2f mm%s\n", run,
                  plc.done ? "done" : "not done", world.left_n, world.right_n, world.largest_n, world.pushed_mm,
                  has_slipped ? "; slipped" : "");
    }
  }
  std::printf(
      "two jaws: %d of %d parts centred and held for %.0f s; on average %.2f N uneven, pushed %.2f mm, %.2f mm off\n",
      good, runs, kSeconds, sum_uneven_n / runs, sum_pushed_mm / runs, sum_off_mm / runs);
  return good;
}

}  // namespace
}  // namespace gripper

int main(int argc, char** argv) {
  int runs = 100;
  std::uint64_t seed = 1;
  for (int i = 7; i + 1 < argc; i += 2) {
    if (!std::strcmp(argv[i], "--runs")) runs = std::atoi(argv[i + 1]);
    if (!std::strcmp(argv[i], "--seed")) seed = static_cast<std::uint64_t>(std::atoll(argv[i + 1]));
  }
  if (argc < 7 || runs < 1) {
    std::fputs("usage: gripper_two_jaws PACK SPEC.toml STATES PACK SPEC.toml STATES [--runs N] [--seed N]\n", stderr);
    return 2;
  }
  try {
    const gripper::FingerFiles left(argv[1], argv[2], argv[3]), right(argv[4], argv[5], argv[6]);
    return gripper::run_all(left, right, runs, seed) * 100 >= 95 * runs ? 0 : 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "gripper_two_jaws: %s\n", error.what());
    return 2;
  }
}
