#include "hostgen/hard_cases/hard_search.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <sstream>
#include <stdexcept>

#include "firmware/shape/newton.h"
#include "hostgen/hard_cases/hard_case.h"
#include "hostgen/hard_cases/shape_distance.h"
#include "hostgen/util/common.h"
#include "hostgen/util/random.h"

namespace finsight::host {

namespace {

constexpr const char* kWords[] = {"bend", "plates", "lose", "noise"};  // by HardAct::Kind
constexpr std::size_t kNumbers[] = {3, 6, 0, 1};
constexpr char kLetters[] = {'t', 'm', 'l'};  // of the plates
static_assert(kTopPlate == 0 && kMiddlePlate == 1 && kLowPlate == 2);
constexpr std::size_t kWorst = 10;
constexpr Bend kLast{10, 0, 15};
constexpr int kLastFrames = 11;  // in which it is measured exactly
constexpr double kSettled_mm = 0.02;

bool moves(const HardAct& act) { return act.kind == HardAct::Kind::kBend || act.kind == HardAct::Kind::kPlates; }
bool names_plates(const HardAct& act) { return act.kind == HardAct::Kind::kPlates || act.kind == HardAct::Kind::kLose; }
std::size_t number_count(const HardAct& act) { return kNumbers[static_cast<std::size_t>(act.kind)]; }

std::array<bool, kPlates> random_plates(Random& random) {
  std::array<bool, kPlates> plates = {};
  plates[random.index(kPlates)] = true;
  for (bool& plate : plates) plate = plate || random.uniform() < 0.3;
  return plates;
}

HardAct random_act(Random& random) {
  const auto frames = [&] { return random.uniform() < 0.4 ? 1 : 1 + static_cast<int>(random.index(25)); };
  HardAct act{.frames = frames()};
  const double kind = random.uniform();
  if (kind < 0.45) {
    act.number = {random.uniform(-35, 35), random.uniform(-15, 15), random.uniform(-90, 90)};
  } else if (kind < 0.7) {  // from a little to plates that have passed each other and turned over
    act.kind = HardAct::Kind::kPlates;
    act.plates = random_plates(random);
    const double far = std::pow(10, random.uniform(-0.5, 1.8)), turned = std::pow(10, random.uniform(-1.5, 0.5));
    for (std::size_t i = 0; i < 6; ++i) act.number[i] = (i < 3 ? far : turned) * random.uniform(-1, 1);
  } else if (kind < 0.85) {
    act.kind = HardAct::Kind::kLose;
    act.plates = random_plates(random);
  } else {
    act.kind = HardAct::Kind::kNoise;
    act.number[0] = std::pow(10, random.uniform(0, 1.7));
  }
  return act;
}

std::vector<HardAct> random_acts(std::uint64_t seed, std::size_t motion) {
  Random random(seed * 1'000'003 + motion);
  std::vector<HardAct> acts(1 + random.index(5));
  for (HardAct& act : acts) act = random_act(random);
  return parse_hard_acts(text_of(acts));  // with the digits that the text shows, so that it can be run again
}

/// How bad: by what is promised first, then by the error on arrival.
double badness(const FoundCase& found) {
  const HardCaseResult& result = found.result;
  double sum = result.worst_mm;
  if (!result.good()) sum += 1e3;
  if (result.end_flagged) sum += 1e4;
  if (result.inverted_unflagged > 0) sum += 1e5;
  if (result.non_finite > 0) sum += 1e6;
  return sum;
}

double first_digit(double number) {
  const double unit = std::pow(10, std::floor(std::log10(std::abs(number) + 1e-9)));
  return std::round(number / unit) * unit;
}

bool is_possible(const HardAct& act) {
  return act.frames >= 1 && (!names_plates(act) || act.plates[0] || act.plates[1] || act.plates[2]);
}

/// Everything that could be taken away or made simpler, one at a time.
std::vector<std::vector<HardAct>> simpler(const std::vector<HardAct>& acts) {
  std::vector<std::vector<HardAct>> all;
  const auto changed = [&](std::size_t k, const auto& change) {
    std::vector<HardAct> others = acts;
    change(others[k]);
    if (is_possible(others[k]) && text_of(others) != text_of(acts)) all.push_back(std::move(others));
  };
  for (std::size_t k = 0; k < acts.size() && acts.size() > 1; ++k) {
    all.push_back(acts);
    all.back().erase(all.back().begin() + static_cast<std::ptrdiff_t>(k));
  }
  for (std::size_t k = 0; k < acts.size(); ++k) {
    changed(k, [](HardAct& act) { act.frames /= 2; });
    for (std::size_t p = 0; p < kPlates; ++p) changed(k, [&](HardAct& act) { act.plates[p] = false; });
    for (std::size_t i = 0; i < number_count(acts[k]); ++i) {
      changed(k, [&](HardAct& act) { act.number[i] = 0; });
      changed(k, [&](HardAct& act) { act.number[i] = first_digit(act.number[i]); });
      changed(k, [&](HardAct& act) { act.number[i] = std::round(act.number[i]); });
    }
  }
  return all;
}

}  // namespace

HardCaseSearch::HardCaseSearch(const ShapeParts& parts) : parts_(parts) {
  NewtonSolver<double> solver(parts.shape, parts.mount);
  if (!solver.converge(HardMotion(parts.mount).poses(kLast), 1e-6, 200).ok) {
    throw std::runtime_error("search for hard cases: the last pose has no shape");
  }
  truth_mm_.assign(solver.node_mm().begin(), solver.node_mm().end());
}

FoundCase HardCaseSearch::run(std::vector<HardAct> acts) const {
  FoundCase found{.acts = std::move(acts), .result = {.name = {}}};
  HardCaseResult& result = found.result;
  result.family = "found by search";
  result.name = text_of(found.acts);
  result.allowed_steps = max_steps({});
  result.allowed_mm = std::numeric_limits<double>::infinity();
  result.allowed_end_mm = kSettled_mm;
  ShapeStage stage(parts_, {});
  const std::vector<PlatePoses> frames = make_hard_motion(parts_.mount, found.acts).frames;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    const FingerShape& shape = stage.solve(frames[k]);
    examine(parts_, shape, result);
    if (k + kLastFrames < frames.size()) continue;
    const double off_mm = shape_distance(shape.node_mm, std::span<const double>(truth_mm_)).worst_mm;
    found.settling_frames += result.end_flagged || off_mm > kSettled_mm;
    if (result.end_flagged) continue;
    result.end_mm = off_mm;
    result.worst_mm = std::max(result.worst_mm, off_mm);
  }
  return found;
}

FoundCase HardCaseSearch::shrink(FoundCase found) const {
  const double enough = 0.7 * badness(found);
  for (bool is_smaller = true; is_smaller;) {
    is_smaller = false;
    for (std::vector<HardAct>& acts : simpler(found.acts)) {
      FoundCase other = run(std::move(acts));
      if (badness(other) < enough) continue;
      found = std::move(other);
      is_smaller = true;
      break;
    }
  }
  return found;
}

HardMotion make_hard_motion(const MountModel& mount, const std::vector<HardAct>& acts) {
  HardMotion motion(mount);
  std::vector<std::function<void()>> later;  // what hides or disturbs the frames of later acts
  for (const HardAct& act : acts) {
    const int first = static_cast<int>(motion.frames.size());
    if (act.kind == HardAct::Kind::kBend) motion.go(Bend{act.number[0], act.number[1], act.number[2]}, act.frames);
    if (act.kind == HardAct::Kind::kPlates) {
      PlatePoses to = motion.frames.back();
      for (std::size_t p = 0; p < kPlates; ++p) {
        if (!act.plates[p]) continue;
        for (int d = 0; d < 3; ++d) {
          to.plates[p].displacement_mm[d] += static_cast<float>(act.number[static_cast<std::size_t>(d)]);
          to.plates[p].rotation_rad[d] += static_cast<float>(act.number[static_cast<std::size_t>(3 + d)]);
        }
      }
      motion.go(to, act.frames);
    }
    if (act.kind == HardAct::Kind::kLose) {
      std::vector<Plate> plates;
      for (const Plate plate : {kTopPlate, kMiddlePlate, kLowPlate}) {
        if (act.plates[plate]) plates.push_back(plate);
      }
      later.emplace_back([&motion, plates, first, act] { motion.lose(plates, first, act.frames); });
    }
    if (act.kind == HardAct::Kind::kNoise) {
      later.emplace_back([&motion, first, act] { motion.noise(act.number[0], first, act.frames); });
    }
    if (!moves(act)) motion.hold(act.frames / 2);  // so that acts overlap, too
  }
  motion.go(kLast, 10);
  for (const auto& disturb : later) disturb();
  motion.frames.back() = motion.poses(kLast);
  return motion.hold(kLastFrames - 1);
}

std::string text_of(const std::vector<HardAct>& acts) {
  std::ostringstream text;
  for (const HardAct& act : acts) {
    if (&act != acts.data()) text << "; ";
    text << kWords[static_cast<std::size_t>(act.kind)];
    if (names_plates(act)) {
      text << ' ';
      for (std::size_t p = 0; p < kPlates; ++p) {
        if (act.plates[p]) text << kLetters[p];
      }
    }
    for (std::size_t i = 0; i < number_count(act); ++i) text << ' ' << act.number[i];
    text << (moves(act) ? " in " : " for ") << act.frames;
  }
  return text.str();
}

std::vector<HardAct> parse_hard_acts(std::string_view text) {
  std::vector<HardAct> acts;
  std::istringstream all{std::string(text)};
  for (std::string part; std::getline(all, part, ';');) {
    std::istringstream words(part);
    std::string word, plates;
    HardAct& act = acts.emplace_back();
    words >> word;
    const auto kind = std::find(std::begin(kWords), std::end(kWords), word);
    if (kind == std::end(kWords)) throw std::invalid_argument("hard case: '" + word + "' is no act");
    act.kind = static_cast<HardAct::Kind>(kind - std::begin(kWords));
    if (names_plates(act)) words >> plates;
    for (std::size_t p = 0; p < kPlates; ++p) act.plates[p] = plates.find(kLetters[p]) != std::string::npos;
    for (std::size_t i = 0; i < number_count(act); ++i) words >> act.number[i];
    words >> word >> act.frames;
    if (!words || act.frames < 1) throw std::invalid_argument("hard case: '" + part + "' is incomplete");
  }
  return acts;
}

HardSearch HardCaseSearch::search(int motions, std::uint64_t seed) const {
  std::vector<FoundCase> found(static_cast<std::size_t>(motions));
  Progress progress("search for hard cases", found.size());
  parallel_for(found.size(), [&](std::size_t k) {
    found[k] = run(random_acts(seed, k));
    progress.advance();
  });
  std::stable_sort(found.begin(), found.end(),
                   [](const FoundCase& a, const FoundCase& b) { return badness(a) > badness(b); });
  HardSearch search;
  search.motions = motions;
  for (const FoundCase& one : found) search.bad += !one.result.good();
  found.resize(std::min(found.size(), kWorst));
  search.worst = std::move(found);
  if (!search.worst.empty()) search.small = shrink(search.worst.front());
  return search;
}

}  // namespace finsight::host
