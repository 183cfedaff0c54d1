// Area fit: does a fit with nine weights make fingers as they come from a workshop right, and do fingers that were not
// fitted say how wrong they may be? Fingers are drawn (Workshop), solved, and measured by the firmware from the corners
// of their markers on.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>

#include "firmware/input_error.h"
#include "hostgen/accuracy/areas.h"
#include "hostgen/finger/plate_geometry.h"
#include "hostgen/fit/pressed_place.h"
#include "hostgen/fit/virtual_device.h"
#include "hostgen/fit/weight_fit.h"
#include "hostgen/util/common.h"
#include "hostgen/util/gnuplot.h"
#include "hostgen/util/statistics.h"

namespace finsight::host {

using nlohmann::json;

namespace {

constexpr std::uint64_t kFirstFinger = 1;  // those from 1000 on were used to tune the fit
constexpr double kReading_s = 0.2;
constexpr double kRest_s = 120;  // between two touches
constexpr double kLightest_n = 1, kHeaviest_n = 6;
constexpr double kFirm_mm = 4;  // plate motion from which on touches are counted

// Poses smoothed by 50 ms, as a board file can ask for: they have settled when a reading of 0.2 s ends.
constexpr double kSmoothing_ms = 50;
constexpr int kSmoothedFrames = 12;  // of a reading
constexpr int kFramesAtRest = 60;    // until a smoothing device has forgotten the touch

// The finger as its pack takes it, as fitted, with one part of the fit left out each, fitted with smoothed poses, and
// zeroed after every touch instead of once.
enum Variant : std::size_t {
  kBefore,
  kAfter,
  kWithoutScale,
  kWithoutCreep,
  kWithoutHysteresis,
  kWithoutMotions,
  kWithoutOffset,
  kSmoothed,
  kZeroedAgain,
  kVariants
};
constexpr std::array<const char*, kVariants> kVariantNames = {
    "before",          "after",          "without_scale", "without_creep", "without_hysteresis",
    "without_motions", "without_offset", "smoothed",      "zeroed_again"};

/// Errors of one finger, or of all.
struct Errors {
  std::vector<double> force_relative, force_n, force_stated, touch_mm, drift;
  int forces_inside = 0, touches_inside = 0, drifts_inside = 0;

  void add(const Errors& other) {
    const auto append = [](std::vector<double>& to, const std::vector<double>& from) {
      to.insert(to.end(), from.begin(), from.end());
    };
    append(force_relative, other.force_relative);
    append(force_n, other.force_n);
    append(force_stated, other.force_stated);
    append(touch_mm, other.touch_mm);
    append(drift, other.drift);
    forces_inside += other.forces_inside;
    touches_inside += other.touches_inside;
    drifts_inside += other.drifts_inside;
  }
  json figures() const {
    const auto mean = [](const std::vector<double>& numbers) {
      double sum = 0;
      for (const double number : numbers) sum += number;
      return numbers.empty() ? 0 : sum / static_cast<double>(numbers.size());
    };
    const auto share = [](int inside, const std::vector<double>& of) {
      return of.empty() ? 0 : inside / static_cast<double>(of.size());
    };
    return {{"forces", force_relative.size()},
            {"force_relative", mean(force_relative)},
            {"force_mean_n", mean(force_n)},
            {"force_stated", mean(force_stated)},
            {"force_coverage_68", share(forces_inside, force_relative)},
            {"touches", touch_mm.size()},
            {"touch_mean_mm", mean(touch_mm)},
            {"touch_95_mm", quantile(touch_mm, 0.95)},
            {"coverage_68", share(touches_inside, touch_mm)},
            {"drift", mean(drift)},
            {"drift_inside_deviation", share(drifts_inside, drift)}};
  }
};

/// A device at the bench.
struct Watcher {
  VirtualDevice& device;
  int frames = 4;                      ///< of a reading, which is the last of them
  bool zeroes_before_touches = false;  ///< besides the zero when it was mounted
};

/// One finger on the bench: its material's memory, and the devices that look at it.
class Bench {
 public:
  Bench(const VirtualFinger& finger, const std::vector<Watcher>& watchers, const FingerSpec& nominal)
      : finger_(finger),
        watchers_(watchers),
        memory_(finger.memory()),
        stiffness_(finger.spec.youngs_modulus_mpa / nominal.youngs_modulus_mpa) {}

  double strongest_n(const PressedPlace& place) const { return 0.85 * stiffness_ * place.highest_n(); }

  /// The finger is let go for two minutes. What the last touch has left in it has that touch's shape.
  void rest() {
    const double as_n = memory_.bends_as_n(0, kRest_s);
    const std::array<PlateMotion, kPlates> plates =
        last_ ? last_->plates(as_n / stiffness_) : std::array<PlateMotion, kPlates>{};
    for (const Watcher& watcher : watchers_) {
      watcher.device.measure(plates, kRest_s, kFramesAtRest);
      if (watcher.zeroes_before_touches) watcher.device.zero(plates);
    }
  }
  /// Readings of all devices after `for_s`.
  std::vector<TouchReading> press(const PressedPlace& place, double force_n, double for_s = kReading_s) {
    last_ = &place;
    const double as_n = memory_.bends_as_n(finger_.at_fit_temperature_n(force_n), for_s);
    const std::array<PlateMotion, kPlates> plates = place.plates(as_n / stiffness_);
    std::vector<TouchReading> readings;
    for (const Watcher& watcher : watchers_) {
      const int frames = std::min(watcher.frames, static_cast<int>(std::lround(for_s / VirtualDevice::kFrame_s)));
      const std::vector<TouchReading> more = watcher.device.measure(plates, for_s, frames);
      readings.insert(readings.end(), more.begin(), more.end());
    }
    return readings;
  }

 private:
  const VirtualFinger& finger_;
  std::vector<Watcher> watchers_;
  MaterialMemory memory_;
  double stiffness_;
  const PressedPlace* last_ = nullptr;
};

struct Places {
  std::vector<PressedPlace> holes, others;
};

/// Solved on a mesh that no pack is made from, for the spec's Young's modulus: forces scale with the finger's own.
Places solve_places(const VirtualFinger& finger, const FingerSpec& nominal, int others) {
  FingerSpec spec = finger.spec;
  spec.youngs_modulus_mpa = nominal.youngs_modulus_mpa;
  FingerStatics statics(spec, make_mesh(spec, MeshSize::kMedium));
  const auto place = [&](const Vec3f& point_mm) {
    const double height =
        (static_cast<double>(point_mm.y()) - nominal.touch_y_mm[0]) / (nominal.touch_y_mm[1] - nominal.touch_y_mm[0]);
    return PressedPlace(statics, point_mm, kHeaviest_n * (1.6 - 0.9 * height));
  };
  Places places;
  for (const JigHole& hole : jig_holes(nominal)) places.holes.push_back(place(hole.contact_mm.cast<float>()));
  Random random(finger.number);
  for (int i = 0; i < others; ++i) {
    const double y_mm = random.uniform(nominal.touch_y_mm[0], nominal.touch_y_mm[1]);
    const double x_mm = random.uniform(-1, 1) * (nominal.half_width.at(y_mm) - nominal.touch_edge_mm);
    places.others.push_back(place(front_point_mm(nominal, x_mm, y_mm).cast<float>()));
  }
  return places;
}

/// What a user hangs up: six, three and two and a half newtons from the lowest row on, a minute in the middle of each.
/// The records of each of the bench's devices.
std::vector<std::vector<WeightRecord>> weigh(const Places& places, const FitBasis& basis, std::size_t devices,
                                             Bench& bench) {
  constexpr std::array<double, 3> kForces_n = {5.9, 2.9, 2.45};
  std::vector<std::vector<WeightRecord>> records(devices);
  for (std::size_t h = 0; h < places.holes.size(); ++h) {
    const PressedPlace& place = places.holes[h];
    const double force_n = std::min(kForces_n[3 * h / places.holes.size()], bench.strongest_n(place));
    bench.rest();
    for (auto& of_device : records) {
      of_device.push_back(
          {.name = "hole " + std::to_string(h + 1), .hole = basis.holes[h].number, .force_n = force_n, .readings = {}});
    }
    const int readings = h % 3 == 1 ? 300 : 35;
    for (int i = 0; i < readings; ++i) {
      const std::vector<TouchReading> of_devices = bench.press(place, force_n);
      for (std::size_t d = 0; d < devices; ++d) records[d].back().readings.push_back(of_devices[d]);
    }
  }
  return records;
}

void judge(const TouchReading& reading, const PressedPlace& place, double force_n, Errors& errors) {
  if (!reading.is_valid) return;
  const double error_n = std::abs(reading.force_n - force_n);
  errors.force_relative.push_back(error_n / force_n);
  errors.force_n.push_back(error_n);
  errors.force_stated.push_back(reading.force_sigma_n / reading.force_n);
  errors.forces_inside += error_n <= reading.force_sigma_n;
  if (static_cast<double>(reading.plate_motion_mm) < kFirm_mm) return;
  const double error_mm = static_cast<double>((reading.point_mm - place.point_mm()).norm());
  errors.touch_mm.push_back(error_mm);
  errors.touches_inside += error_mm <= reading.radius_mm;
}

using AllErrors = std::array<Errors, kVariants>;

/// Touches at places where no weight hung, each at a random force, age, and history: half of them after more force.
void touch_elsewhere(const Places& places, Random& random, Bench& bench, AllErrors& errors) {
  for (const PressedPlace& place : places.others) {
    const double strongest_n = std::min(bench.strongest_n(place), kHeaviest_n);
    if (strongest_n < kLightest_n) continue;
    const double force_n = random.uniform(kLightest_n, strongest_n);
    const bool was_more = random.uniform() < 0.5;
    const double before_n = std::min(1.3 * force_n, strongest_n);
    bench.rest();
    for (int i = 1; i <= 5 && was_more; ++i) bench.press(place, before_n * i / 5);
    const int held = 1 + static_cast<int>(random.index(100));
    std::vector<TouchReading> last;
    for (int i = 0; i < held; ++i) last = bench.press(place, force_n);
    for (std::size_t v = 0; v < kVariants; ++v) judge(last[v], place, force_n, errors[v]);
  }
}

/// What the devices say over two seconds: means of the valid frames, and the last readings.
struct Average {
  std::array<double, kVariants> force_n{};
  std::vector<TouchReading> last;
};

Average average(const PressedPlace& place, double force_n, Bench& bench) {
  constexpr int kAveraged = 120;
  Average result;
  std::array<int, kVariants> valid{};
  for (int frame = 0; frame < kAveraged; ++frame) {
    result.last = bench.press(place, force_n, VirtualDevice::kFrame_s);
    for (std::size_t v = 0; v < kVariants; ++v) {
      if (!result.last[v].is_valid) continue;
      ++valid[v];
      result.force_n[v] += (result.last[v].force_n - result.force_n[v]) / valid[v];
    }
  }
  return result;
}

/// A force that lasts for a minute, at two of the holes: from one second after it came on.
void hold_for_a_minute(const Places& places, Bench& bench, AllErrors& errors) {
  constexpr int kBeforeFirst = 5, kBetween = 275;  // readings
  for (const std::size_t hole : {std::size_t{1}, places.holes.size() - 2}) {
    const PressedPlace& place = places.holes[hole];
    const double force_n = std::min(3.5, bench.strongest_n(place));
    bench.rest();
    for (int i = 0; i < kBeforeFirst; ++i) bench.press(place, force_n);
    const Average first = average(place, force_n, bench);
    for (int i = 0; i < kBetween; ++i) bench.press(place, force_n);
    const Average last = average(place, force_n, bench);
    for (std::size_t v = 0; v < kVariants; ++v) {
      if (!first.last[v].is_valid || !last.last[v].is_valid) continue;
      errors[v].drift.push_back(std::abs(last.force_n[v] / first.force_n[v] - 1));
      errors[v].drifts_inside += std::abs(last.force_n[v] - first.force_n[v]) <= last.last[v].force_sigma_n;
    }
  }
}

std::vector<LoopSettings> variants_of(const FitValues& fit) {
  std::vector<LoopSettings> settings(kSmoothed);
  for (std::size_t v = kAfter; v < kSmoothed; ++v) settings[v].fit = fit;
  settings[kWithoutScale].fit->force_scale = 1;
  settings[kWithoutScale].fit->force_slope.fill(0);
  settings[kWithoutCreep].fit->creep_share = 0;
  settings[kWithoutHysteresis].fit->hysteresis = 0;
  settings[kWithoutMotions].fit->motion_change.setZero();
  settings[kWithoutOffset].fit->across_mm.fill(0);
  settings[kWithoutOffset].fit->along_mm.fill(0);
  return settings;
}

struct FingerResult {
  AllErrors errors;
  FitValues fit;
  double stiffness = 1;
  std::string refused, smoothed_refused;  ///< by the fit, why
};

FingerResult run_finger(const Model& model, const FingerSpec& spec, const FitBasis& basis, std::uint64_t number,
                        int others) {
  const VirtualFinger finger = draw_finger(spec, number);
  const Places places = solve_places(finger, spec, others);
  FingerResult result;
  result.stiffness = finger.spec.youngs_modulus_mpa / spec.youngs_modulus_mpa;
  LoopSettings smoothing;
  smoothing.smoothing_ms = kSmoothing_ms;
  smoothing.fit = weighing(model.touch);
  LoopSettings plain;
  plain.fit = smoothing.fit;
  VirtualDevice unfitted(model, spec, finger, {plain}, 2 * number),
      unfitted_smoothing(model, spec, finger, {smoothing}, 2 * number);
  Bench at_fit(finger, {{unfitted}, {unfitted_smoothing, kSmoothedFrames}}, spec);
  const std::vector<std::vector<WeightRecord>> records = weigh(places, basis, 2, at_fit);
  const auto fit = [&](const std::vector<WeightRecord>& weights, FitValues& values) -> std::string {
    try {
      values = fit_weights(basis, weights, 1).values;
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  };
  result.refused = fit(records[0], result.fit);
  if (!result.refused.empty()) return result;
  result.smoothed_refused = fit(records[1], smoothing.fit.emplace());
  LoopSettings fitted;
  fitted.fit = result.fit;
  VirtualDevice devices(model, spec, finger, variants_of(result.fit), 2 * number + 1),
      smoothing_device(model, spec, finger, {smoothing}, 2 * number + 1),
      zeroed_again(model, spec, finger, {fitted}, 2 * number + 1);
  Bench in_use(
      finger, {{devices}, {smoothing_device, kSmoothedFrames}, {.device = zeroed_again, .zeroes_before_touches = true}},
      spec);
  Random random(number + 500);
  touch_elsewhere(places, random, in_use, result.errors);
  hold_for_a_minute(places, in_use, result.errors);
  if (!result.smoothed_refused.empty()) result.errors[kSmoothed] = {};
  return result;
}

void plot_fingers(const std::vector<FingerResult>& results, const std::filesystem::path& file) {
  Gnuplot plot(file);
  plot.line("set term svg size 900,420 font ',11' background 'white'; set multiplot layout 1,2; set grid");
  for (const bool force : {true, false}) {
    plot.line(std::string("$fingers << E"));
    for (const FingerResult& result : results) {
      const json before = result.errors[kBefore].figures(), after = result.errors[kAfter].figures();
      const char* key = force ? "force_relative" : "touch_mean_mm";
      const double scale = force ? 100 : 1;
      plot.line(std::to_string(scale * before[key].get<double>()) + " " +
                std::to_string(scale * after[key].get<double>()));
    }
    plot.line("E");
    plot.line(std::string("set xlabel '") + (force ? "mean force error before, %" : "mean touch error before, mm") +
              "'; set ylabel 'after nine weights'; set xrange [0:*]; set yrange [0:*]; unset key");
    plot.line("plot $fingers using 1:2 with points pt 7 ps 0.6, x with lines dt 2 lc 'gray'");
  }
  plot.line("unset multiplot");
  plot.finish();
}

}  // namespace

json measure_fits(const Model& model, const FingerSpec& spec, const std::filesystem::path& folder, int fingers,
                  int places, std::uint64_t first) {
  FitBasis basis = fit_basis(spec, model);
  basis.motions = motion_basis(spec, basis.holes);
  std::vector<FingerResult> results(static_cast<std::size_t>(fingers));
  Progress progress("virtual fingers", results.size());
  parallel_for(results.size(), [&](std::size_t i) {
    results[i] = run_finger(model, spec, basis, first + i, places);
    progress.advance();
  });
  AllErrors all;
  json rows = json::array();
  int refused = 0;
  for (std::size_t i = 0; i < results.size(); ++i) {
    const FingerResult& result = results[i];
    json row = {{"finger", first + i}, {"stiffness", result.stiffness}};
    if (result.refused.empty()) {
      row.update({{"force_scale", result.fit.force_scale},
                  {"creep_share", result.fit.creep_share},
                  {"before", result.errors[kBefore].figures()},
                  {"after", result.errors[kAfter].figures()}});
    } else {
      ++refused;
      row["refused"] = result.refused;
    }
    if (!result.smoothed_refused.empty()) row["smoothed_refused"] = result.smoothed_refused;
    rows.push_back(row);
    for (std::size_t v = 0; v < kVariants; ++v) all[v].add(result.errors[v]);
  }
  json fit = {{"fingers", fingers}, {"refused", refused}, {"scene", model.scene}, {"each", rows}};
  for (std::size_t v = 0; v < kVariants; ++v) {
    json row = all[v].figures();
    fit[kVariantNames[v]] = row;
    std::printf("%-15s %s\n", kVariantNames[v], row.dump().c_str());
    row["fit"] = kVariantNames[v];
    fit["rows"].push_back(row);
  }
  plot_fingers(results, folder / "fit.svg");
  return {{"fit", fit}};
}

json measure_fits(const Model& model, const FingerSpec& spec, const std::filesystem::path& folder, bool quick) {
  return measure_fits(model, spec, folder, quick ? 2 : 50, quick ? 6 : 12, kFirstFinger);
}

}  // namespace finsight::host
