#include "hostgen/hard_cases/hard_cases.h"

#include <cmath>
#include <functional>
#include <iterator>
#include <limits>

#include "hostgen/hard_cases/hard_case.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

std::string signed_number(double value) {
  std::string text = value < 0 ? "-" : "+";
  return text.append(std::to_string(std::lround(std::abs(value))));
}

void add_bends(const MountModel& mount, std::vector<HardCase>& cases) {
  const auto there_and_back = [&](const std::string& name, const Bend& bend, double speed, double allowed_mm) {
    cases.push_back({name, HardMotion(mount).bend(bend, speed).hold(3).bend({}, speed).hold(10), allowed_mm});
  };
  for (const double sign : {1.0, -1.0}) {
    there_and_back("bend " + signed_number(30 * sign) + " mm", {30 * sign, 0, 0}, 1, 0.1);
    there_and_back("sideways " + signed_number(15 * sign) + " mm", {0, 15 * sign, 0}, 1, 0.1);
    there_and_back("twist " + signed_number(45 * sign) + " deg", {0, 0, 45 * sign}, 1, 0.1);
    for (const double other : {1.0, -1.0}) {
      const std::string twist = ", twist " + signed_number(45 * other) + " deg";
      there_and_back("bend " + signed_number(30 * sign) + " mm" + twist, {30 * sign, 0, 45 * other}, 1, 0.1);
      there_and_back("bend " + signed_number(30 * sign) + " mm" + twist + ", 4 times as fast",
                     {30 * sign, 0, 45 * other}, 4, 0.3);
      there_and_back(
          "bend " + signed_number(20 * sign) + " mm, sideways " + signed_number(10 * other) + " mm, twist -30 deg",
          {20 * sign, 10 * other, -30}, 1, 0.1);
    }
  }
  there_and_back("bend +40 mm, twist +90 deg", {40, 0, 90}, 1, 0.3);
}

void add_jumps(const MountModel& mount, std::vector<HardCase>& cases) {
  const Bend far{30, 0, 45}, opposite{-30, 0, -45};
  const auto jumps = [&](const std::string& name, const Bend& a, const Bend& b, int times, int held) {
    HardMotion motion(mount);
    for (int k = 0; k < times; ++k) motion.go(k % 2 == 0 ? a : b, 1).hold(held);
    cases.push_back({name, motion.go(Bend{}, 1).hold(10), kNoLimit});
  };
  jumps("jump from rest to the extreme and back", far, {}, 1, 10);
  jumps("jumps between rest and the extreme, every frame", far, {}, 20, 0);
  jumps("jumps between opposite extremes, every frame", far, opposite, 20, 0);
  jumps("jumps between opposite extremes, every fifth frame", far, opposite, 10, 4);
  jumps("jump by 90 degrees of twist and back", {0, 0, 90}, {}, 1, 10);
  jumps("jump by 170 degrees of twist and back", {0, 0, 170}, {}, 1, 10);
  cases.push_back({"jump to the extreme, which stays", HardMotion(mount).go(far, 1).hold(20), kNoLimit});
}

// Each is reached in one frame and slowly, held, and left in the same way.
void add_impossible(const MountModel& mount, std::vector<HardCase>& cases) {
  const PlatePoses rest = HardMotion(mount).poses({});
  const auto centre_y = [&](Plate plate) { return mount.T_finger_marker[plate].translation().y(); };
  std::vector<std::pair<std::string, PlatePoses>> poses;
  const auto add = [&](const std::string& name, auto change) {
    PlatePoses changed = rest;
    change(changed.plates);
    poses.emplace_back(name, changed);
  };
  constexpr float kHalfTurn = 3.14159f;
  const float way = centre_y(kTopPlate) - centre_y(kLowPlate);
  add("top plate below the low one", [&](auto& p) { p[kTopPlate].displacement_mm.y() = -way - 10; });
  add("top and low plate swapped", [&](auto& p) {
    p[kTopPlate].displacement_mm.y() = -way;
    p[kLowPlate].displacement_mm.y() = way;
  });
  add("middle plate flipped about z", [&](auto& p) { p[kMiddlePlate].rotation_rad.z() = kHalfTurn; });
  add("top plate flipped about y", [&](auto& p) { p[kTopPlate].rotation_rad.y() = kHalfTurn; });
  add("all plates flipped about x", [&](auto& p) {
    for (PlateMotion& plate : p) plate.rotation_rad.x() = kHalfTurn;
  });
  add("all plates at one point", [&](auto& p) {
    for (const Plate plate : {kTopPlate, kMiddlePlate, kLowPlate})
      p[plate].displacement_mm.y() = centre_y(kMiddlePlate) - centre_y(plate);
  });
  add("all plates below the base", [&](auto& p) {
    for (PlateMotion& plate : p) plate.displacement_mm.y() = -2 * centre_y(kTopPlate);
  });
  add("top plate far to the side", [&](auto& p) { p[kTopPlate].displacement_mm.x() = 2 * way; });
  for (const auto& [name, target] : poses) {
    cases.push_back({name + ", jump", HardMotion(mount).go(target, 1).hold(10).go(rest, 1).hold(10), kNoLimit});
    cases.push_back({name + ", slowly", HardMotion(mount).go(target, 60).hold(10).go(rest, 60).hold(10), kNoLimit});
    cases.push_back({name + ", stays", HardMotion(mount).go(target, 30).hold(30), kNoLimit, kNoLimit, true});
  }
  HardMotion wound(mount);
  for (int degree = 3; degree <= 360; degree += 3) {
    PlatePoses turned = rest;
    turned.plates[kTopPlate].rotation_rad.y() = static_cast<float>(degree) / 180 * kHalfTurn;
    wound.go(turned, 1);
  }
  cases.push_back({"top plate turned once around in steps of 3 degrees", wound.go(rest, 1).hold(10), kNoLimit});
}

void add_losses(const MountModel& mount, std::vector<HardCase>& cases) {
  for (const int count : {1, 10, 100}) {
    const auto lost = [&](const std::string& what, const std::vector<Plate>& plates) {
      HardMotion motion(mount);
      motion.bend({25, 5, 30}).bend({-10, 0, 0}).bend({25, 5, 30}).bend({}).hold(10);
      cases.push_back(
          {what + " missing for " + std::to_string(count) + " frames", motion.lose(plates, 20, count), kNoLimit});
    };
    lost("one plate", {kTopPlate});
    lost("two plates", {kTopPlate, kMiddlePlate});
    lost("all plates", {kTopPlate, kMiddlePlate, kLowPlate});
  }
}

void add_numbers(const MountModel& mount, std::vector<HardCase>& cases) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const std::pair<const char*, float> bad[] = {{"NaN", std::numeric_limits<float>::quiet_NaN()},
                                               {"infinity", kInfinity},
                                               {"-infinity", -kInfinity},
                                               {"1e30", 1e30f},
                                               {"-1e5", -1e5f},
                                               {"a denormal number", 1e-42f}};
  for (const auto& [name, value] : bad) {
    HardMotion motion(mount);
    motion.bend({10, 0, 10});
    for (int i = 0; i < kPoseDims; ++i) motion.spoil(i, value);
    cases.push_back({std::string(name) + " in every number", motion.hold(10), kNoLimit});
  }
  HardMotion turns(mount);
  turns.bend({5, 0, 5});
  for (const float turn : {3.14159f, 3.2f, 6.2832f, 6.9f}) turns.spoil(6 * kTopPlate + 1, turn).hold(3);
  cases.push_back({"rotations of half a turn and a whole one", turns.hold(10), kNoLimit});
}

void add_noise(const MountModel& mount, std::vector<HardCase>& cases) {
  for (const int size : {1, 5, 20}) {
    HardMotion motion(mount);
    motion.bend({10, 3, 15}).bend({-5, 0, 0}).noise(size).hold(10);
    cases.push_back({"noise of the poses, " + std::to_string(size) + " times", motion, size * 0.2});
  }
}

}  // namespace

std::vector<HardCaseResult> run_hard_cases(const ShapeParts& parts, int walk_frames) {
  constexpr std::pair<const char*, void (*)(const MountModel&, std::vector<HardCase>&)> kMotions[] = {
      {"bends and twists", add_bends},      {"jumps", add_jumps},
      {"impossible poses", add_impossible}, {"plates not seen", add_losses},
      {"spoilt numbers", add_numbers},      {"noise", add_noise}};
  struct Job {
    const char* family;
    std::function<void(std::vector<HardCaseResult>&)> run;
  };
  std::vector<Job> jobs;
  std::vector<HardCase> cases;
  for (const auto& [family, add] : kMotions) {
    const std::size_t first = cases.size();
    add(parts.mount, cases);
    for (std::size_t k = first; k < cases.size(); ++k) {
      jobs.push_back({family, [&, k](auto& found) { found.push_back(run_hard_case(parts, cases[k])); }});
    }
  }
  for (const HardVariant& variant : hard_variants()) {
    jobs.push_back({variant.family, [&](auto& found) { variant.run(parts, found); }});
  }
  jobs.push_back({"random walk", [&](auto& found) { found.push_back(run_random_walk(parts, walk_frames)); }});
  std::vector<std::vector<HardCaseResult>> found(jobs.size());
  Progress progress("hard cases", jobs.size());
  parallel_for(jobs.size(), [&](std::size_t k) {
    const std::size_t i = jobs.size() - 1 - k;  // the last are the longest, so they begin first
    jobs[i].run(found[i]);
    for (HardCaseResult& result : found[i]) result.family = jobs[i].family;
    progress.advance();
  });
  std::vector<HardCaseResult> results;
  for (auto& part : found) std::move(part.begin(), part.end(), std::back_inserter(results));
  return results;
}

// Bend and twist wander within the finger's range and speed, with the camera's noise. Every thousandth frame is
// compared with the truth, which reveals drift and a wrong minimum that lasts.
HardCaseResult run_random_walk(const ShapeParts& parts, int frames) {
  HardCaseResult result{.family = "random walk", .name = "random walk of " + std::to_string(frames) + " frames"};
  result.allowed_steps = max_steps({});
  result.allowed_mm = result.allowed_end_mm = 0.1;
  ShapeStage stage(parts, {});
  HardCaseTruth truth(parts, 1);
  Random random(7);
  const Bend range{30, 10, 45};
  Bend bend, target;
  for (int frame = 0; frame < frames; ++frame) {
    if (frame % 60 == 0)
      target = {random.uniform(-1, 1) * range.bend_mm, random.uniform(-1, 1) * range.sideways_mm,
                random.uniform(-1, 1) * range.twist_deg};
    const auto approach = [](double& value, double goal) { value += 0.03 * (goal - value); };
    approach(bend.bend_mm, target.bend_mm);
    approach(bend.sideways_mm, target.sideways_mm);
    approach(bend.twist_deg, target.twist_deg);
    const PlatePoses poses = HardMotion(parts.mount).poses(bend);
    const FingerShape& shape = stage.solve(poses);
    examine(parts, shape, result);
    if (frame % 1000 != 999 && frame + 1 != frames) continue;
    if (const auto distance_mm = truth.distance(poses, shape.node_mm)) {
      result.end_mm = *distance_mm;
      result.worst_mm = std::max(result.worst_mm, *distance_mm);
    }
  }
  return result;
}

}  // namespace finsight::host
