#include "hostgen/fit/verification.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "firmware/input_error.h"
#include "hostgen/util/gravity.h"
#include "hostgen/util/statistics.h"

namespace finsight::host {

namespace {

constexpr double kStep_s = 0.7;  // from one weight to the next, at most, and until it has come to rest
constexpr double kShortestPlateau_s = 1;
constexpr double kLongHold_s = 60;  // from which on creep is stated
constexpr const char* kAllDetected = "weights that were detected";
constexpr double kWeights = 0.001;  // relative deviation of ordinary weights, and of gravity from place to place

double mean_of(const std::vector<double>& numbers) {
  double sum = 0;
  for (const double number : numbers) sum += number;
  return numbers.empty() ? 0 : sum / static_cast<double>(numbers.size());
}

double deviation_of(const std::vector<double>& numbers) {
  const double mean = mean_of(numbers);
  double sum = 0;
  for (const double number : numbers) sum += (number - mean) * (number - mean);
  return numbers.size() > 1 ? std::sqrt(sum / static_cast<double>(numbers.size() - 1)) : 0;
}

std::optional<double> optional_limit(TomlTable& table, const char* key, double highest) {
  if (!table.has(key)) return std::nullopt;
  return table.number(key, 0, highest);
}

struct Stretch {
  std::size_t first, end;
};

/// Where the force does not change: between steps, each of which is at least a tenth of the force.
std::vector<Stretch> plateaus_in(const std::vector<TouchReading>& readings) {
  std::vector<Stretch> found;
  for (std::size_t i = 0; i < readings.size();) {
    if (!readings[i].is_valid) {
      ++i;
      continue;
    }
    // Settled: what follows within kStep_s is the same force.
    const auto after = [&](std::size_t from, double seconds) {
      std::size_t to = from;
      while (to < readings.size() && readings[to].time_s < readings[from].time_s + seconds) ++to;
      return to;
    };
    const auto median_n = [&](std::size_t from, std::size_t to) {
      std::vector<double> forces;
      for (std::size_t k = from; k < to; ++k) {
        if (readings[k].is_valid) forces.push_back(readings[k].force_n);
      }
      return 2 * forces.size() > to - from ? quantile(forces, 0.5) : -1;
    };
    const std::size_t soon = after(i, kStep_s / 2);
    const double here_n = median_n(i, soon), next_n = median_n(soon, after(soon, kStep_s / 2));
    const auto is_same = [](double a_n, double b_n) { return std::abs(a_n - b_n) < std::max(0.06 * b_n, 0.1); };
    if (here_n < 0 || next_n < 0 || !is_same(here_n, next_n)) {
      ++i;
      continue;
    }
    std::size_t end = soon;
    double now_n = here_n;  // creep is slow: compared with what was just before
    while (end < readings.size()) {
      const std::size_t to = after(end, kStep_s / 2);
      const double n = median_n(end, to);
      if (n < 0 || !is_same(n, now_n)) break;
      now_n = n;
      end = to;
    }
    if (readings[end - 1].time_s - readings[i].time_s >= kShortestPlateau_s) found.push_back({i, end});
    i = std::max(end, i + 1);
  }
  return found;
}

Plateau plateau_of(const std::vector<TouchReading>& readings, const Stretch& stretch) {
  Plateau plateau;
  std::vector<double> forces, sigma, radius;
  Vec3f sum_mm = Vec3f::Zero();
  const double first_s = readings[stretch.first].time_s, last_s = readings[stretch.end - 1].time_s;
  const double cut_s = std::min(kStep_s / 2, (last_s - first_s) / 4);
  for (std::size_t i = stretch.first; i < stretch.end; ++i) {
    const TouchReading& reading = readings[i];
    if (!reading.is_valid || reading.time_s < first_s + cut_s || reading.time_s > last_s - cut_s) continue;
    forces.push_back(reading.force_n);
    sigma.push_back(reading.force_sigma_n);
    radius.push_back(reading.radius_mm);
    sum_mm += reading.point_mm;
  }
  plateau.poses = readings[(stretch.first + stretch.end) / 2].poses;
  plateau.lasted_s = last_s - first_s;
  plateau.found_n = mean_of(forces);
  plateau.sigma_n = mean_of(sigma);
  plateau.radius_mm = mean_of(radius);
  plateau.found_mm = sum_mm / static_cast<float>(std::max<std::size_t>(1, forces.size()));
  const auto part = static_cast<std::ptrdiff_t>(forces.size() / 10 + 1);
  plateau.drift_n = mean_of({forces.end() - part, forces.end()}) - mean_of({forces.begin(), forces.begin() + part});
  std::vector<double> steps;
  for (std::size_t i = 1; i < forces.size(); ++i) steps.push_back(forces[i] - forces[i - 1]);
  plateau.noise_n = deviation_of(steps) / std::sqrt(2.0);
  return plateau;
}

/// Which of the planned forces each plateau is: in their order, the best fit of all that leave out the others. `forces`
/// are at least as many as `found`.
std::vector<std::size_t> planned_places(const std::vector<double>& forces, const std::vector<Plateau>& found) {
  const std::size_t columns = found.size() + 1;
  std::vector<double> cost((forces.size() + 1) * columns, std::numeric_limits<double>::infinity());
  std::vector<char> is_taken(cost.size());
  for (std::size_t f = 0; f <= forces.size(); ++f) {
    cost[f * columns] = 0;
    for (std::size_t p = 1; p <= std::min(f, found.size()); ++p) {
      const double off = std::abs(std::log(std::max(found[p - 1].found_n, 1e-3) / forces[f - 1]));
      const double taken = cost[(f - 1) * columns + p - 1] + off, left_out = cost[(f - 1) * columns + p];
      is_taken[f * columns + p] = taken < left_out;
      cost[f * columns + p] = std::min(taken, left_out);
    }
  }
  std::vector<std::size_t> places(found.size());
  for (std::size_t f = forces.size(), p = found.size(); p > 0; --f) {
    if (is_taken[f * columns + p]) places[--p] = f - 1;
  }
  return places;
}

void add_series(const PlannedSeries& series, const JigHole& hole, const std::vector<TouchReading>& readings,
                Verification& result) {
  std::vector<Plateau> found;
  for (const Stretch& stretch : plateaus_in(readings)) found.push_back(plateau_of(readings, stretch));
  std::vector<double> forces;
  for (const double mass_g : series.mass_g) forces.push_back(weight_n(mass_g));
  const auto refuse = [&](const std::string& why) {
    throw InputError(series.where, series.session + ": weights at rest", std::to_string(found.size()),
                     std::to_string(forces.size()) + " as planned" + why);
  };
  if (found.size() > forces.size()) refuse("");
  const std::vector<std::size_t> places = planned_places(forces, found);
  double lightest_n = std::numeric_limits<double>::infinity();
  for (const std::size_t place : places) lightest_n = std::min(lightest_n, forces[place]);
  for (std::size_t f = 0; f < forces.size(); ++f) {
    if (std::ranges::find(places, f) != places.end()) continue;
    if (forces[f] > lightest_n) {
      refuse(": one of " + std::to_string(std::lround(series.mass_g[f])) +
             " g is missing, although a lighter one was seen; each has to rest for a second");
    }
    result.missed.push_back({series.session, series.hole, forces[f]});
  }
  for (std::size_t i = 0; i < found.size(); ++i) {
    const std::size_t place = places[i];
    found[i].session = series.session;
    found[i].hole = series.hole;
    found[i].force_n = forces[place];
    found[i].is_down = place > 0 && forces[place] < forces[place - 1];
    found[i].truth_mm = hole.contact_mm.cast<float>();
    result.plateaus.push_back(found[i]);
  }
}

double touch_error_mm(const Plateau& plateau) {
  return static_cast<double>((plateau.found_mm - plateau.truth_mm).norm());
}

/// Differences between plateaus of the same weight at the same hole, relative to it: in the same direction, or up and
/// down.
std::vector<double> differences(const std::vector<Plateau>& plateaus, bool same_direction) {
  std::vector<double> found;
  for (std::size_t i = 0; i < plateaus.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      const Plateau &a = plateaus[i], &b = plateaus[j];
      if (a.hole != b.hole || a.force_n != b.force_n || (a.is_down == b.is_down) != same_direction) continue;
      found.push_back(std::abs(a.found_n - b.found_n) / a.force_n);
    }
  }
  return found;
}

std::optional<double> largest(const std::vector<double>& numbers) {
  if (numbers.empty()) return std::nullopt;
  return *std::ranges::max_element(numbers);
}

/// How far the plates stand from their zero once the last weight is off: the end of a recording without a touch.
std::vector<double> zero_returns_mm(const std::vector<std::vector<TouchReading>>& all) {
  std::vector<double> found;
  for (const std::vector<TouchReading>& readings : all) {
    if (readings.back().is_valid) continue;
    std::vector<double> motion;
    for (auto reading = readings.rbegin(); reading != readings.rend() && !reading->is_valid; ++reading) {
      if (readings.back().time_s - reading->time_s > 0.5) break;
      motion.push_back(static_cast<double>(reading->plate_motion_mm));
    }
    found.push_back(mean_of(motion));
  }
  return found;
}

std::optional<double> scaled(std::optional<double> value, double factor) {
  if (value) *value *= factor;
  return value;
}

double rms(const std::vector<double>& numbers) {
  double sum = 0;
  for (const double number : numbers) sum += number * number;
  return numbers.empty() ? 0 : std::sqrt(sum / static_cast<double>(numbers.size()));
}

/// How far force and place are off (RMS over all weights) if every plate's motion is changed so.
BudgetLine changed_by(const Verification& result, const PoseReader& read,
                      const std::function<void(PlateMotion&)>& change) {
  std::vector<double> force_n, touch_mm;
  for (const Plateau& plateau : result.plateaus) {
    PlatePoses poses = plateau.poses;
    const ForceAndPlace before = read(poses);
    for (PlateMotion& plate : poses.plates) change(plate);
    const ForceAndPlace after = read(poses);
    force_n.push_back(after.force_n - before.force_n);
    touch_mm.push_back(static_cast<double>((after.point_mm - before.point_mm).norm()));
  }
  return {.source = "", .how = "", .force_n = rms(force_n), .touch_mm = rms(touch_mm)};
}

/// A lens whose focal length is off by so much stretches motions along the camera's axis: the zero takes out the rest.
BudgetLine lens_part(const Verification& result, const VerificationKind& kind) {
  constexpr double kFocalLength = 0.01;
  const Vec3f axis = kind.R_finger_camera.col(2).cast<float>();
  BudgetLine line = changed_by(result, kind.read_poses, [&](PlateMotion& plate) {
    constexpr auto kStretch = static_cast<float>(kFocalLength / std::numbers::sqrt3);
    plate.displacement_mm += kStretch * plate.displacement_mm.dot(axis) * axis;
  });
  line.source = "lens";
  line.how = "focal length within 1 %, even distribution, by the pack";
  return line;
}

/// A camera that is turned against where it is believed turns all motions; that it is shifted, the zero takes out.
BudgetLine mount_part(const Verification& result, const VerificationKind& kind) {
  constexpr double kUntold_deg = 1.5, kTold_deg = 0.5;
  const double turn_rad = (kind.has_turn_told ? kTold_deg : kUntold_deg) * std::numbers::pi / 180 / std::numbers::sqrt3;
  BudgetLine line{.source = "mount",
                  .how = kind.has_turn_told
                             ? "camera turned by up to 0.5 deg about each axis, as measured, by the pack"
                             : "camera turned by up to 1.5 deg about each axis, not measured, by the pack"};
  for (int axis = 0; axis < 3; ++axis) {
    const Vec3f turn = static_cast<float>(turn_rad) * Vec3f::Unit(axis);
    const BudgetLine about = changed_by(result, kind.read_poses, [&](PlateMotion& plate) {
      plate.displacement_mm += turn.cross(plate.displacement_mm).eval();
      plate.rotation_rad += turn.cross(plate.rotation_rad).eval();
    });
    line.force_n = std::hypot(line.force_n, about.force_n);
    line.touch_mm = std::hypot(line.touch_mm, about.touch_mm);
  }
  return line;
}

/// Splits the errors of the weights: what all forces have in common, relative to them, is the material's stiffness; of
/// what remains, lens and mount have at most their parts, and the rest is the model's.
void split_errors(const VerificationKind& kind, double force_n, double touch_mm, Verification& result) {
  std::vector<double> relative, loads_n;
  for (const Plateau& plateau : result.plateaus) {
    relative.push_back(plateau.found_n / plateau.force_n - 1);
    loads_n.push_back(plateau.force_n);
  }
  BudgetLine rest{.source = "model",
                  .how = "errors of all weights, RMS, without the parts above",
                  .force_n = force_n,
                  .touch_mm = touch_mm};
  const auto take = [&](BudgetLine part) {
    const auto out_of = [](double& whole, double& share) {
      share = std::min(share, whole);
      whole = std::sqrt(whole * whole - share * share);
    };
    out_of(rest.force_n, part.force_n);
    out_of(rest.touch_mm, part.touch_mm);
    result.budget.push_back(std::move(part));
  };
  take({.source = "material, stiffness",
        .how = "error that all forces have in common",
        .force_n = std::abs(mean_of(relative)) * rms(loads_n)});
  if (kind.read_poses) {
    take(lens_part(result, kind));
    take(mount_part(result, kind));
  } else {
    rest.source = "lens, mount, model";
  }
  result.budget.push_back(std::move(rest));
}

// GUM: standard deviations of the parts, added in squares. Parts that were not seen in the recordings count with what
// the device itself states.
void make_budget(const VerificationKind& kind, Verification& result) {
  std::vector<double> noise, force_errors, up_down = differences(result.plateaus, false), drifts, x, y, stated_n;
  double heaviest_n = 0;
  for (const Plateau& plateau : result.plateaus) {
    noise.push_back(plateau.noise_n);
    force_errors.push_back(plateau.found_n - plateau.force_n);
    x.push_back(static_cast<double>(plateau.found_mm.x() - plateau.truth_mm.x()));
    y.push_back(static_cast<double>((plateau.found_mm - plateau.truth_mm).tail<2>().norm()) *
                (plateau.found_mm.y() < plateau.truth_mm.y() ? -1 : 1));
    stated_n.push_back(plateau.sigma_n);
    heaviest_n = std::max(heaviest_n, plateau.force_n);
    if (plateau.lasted_s >= kLongHold_s) drifts.push_back(std::abs(plateau.drift_n));
  }
  const auto add = [&](const char* source, const char* how, double force_n, double touch_mm) {
    result.budget.push_back({source, how, force_n, touch_mm});
  };
  add("camera", "scatter of single readings", mean_of(noise), 0);
  split_errors(kind, rms(force_errors), std::hypot(rms(x), rms(y)), result);
  add("material, hysteresis", "half of up minus down, even distribution",
      up_down.empty() ? 0 : mean_of(up_down) * heaviest_n / 2 / std::sqrt(3.0), 0);
  if (drifts.empty())
    add("material, creep", "no hold of a minute: a fifth of the stated deviation", 0.2 * mean_of(stated_n), 0);
  else
    add("material, creep", "drift of the longest holds, even distribution", mean_of(drifts) / std::sqrt(3.0), 0);
  add("weights", "0.1 % of the heaviest, with gravity", kWeights * heaviest_n, 0);
  add("jig", "pin in its bore, 0.15 mm", 0, 0.15);
  double force_sq = 0, touch_sq = 0;
  for (const BudgetLine& line : result.budget) {
    force_sq += line.force_n * line.force_n;
    touch_sq += line.touch_mm * line.touch_mm;
  }
  result.force_expanded_n = 2 * std::sqrt(force_sq);
  result.touch_expanded_mm = 2 * std::sqrt(touch_sq);
}

/// The lightest weight that was seen of those that are heavier than all that were not.
std::optional<double> detection_threshold_n(const Verification& result) {
  double missed_n = 0;
  for (const MissedWeight& weight : result.missed) missed_n = std::max(missed_n, weight.force_n);
  std::optional<double> lightest_n;
  for (const Plateau& plateau : result.plateaus) {
    if (plateau.force_n > missed_n) lightest_n = std::min(lightest_n.value_or(plateau.force_n), plateau.force_n);
  }
  return lightest_n;
}

void make_checks(const VerificationLimits& limits, const std::vector<std::vector<TouchReading>>& readings,
                 Verification& result) {
  std::vector<double> errors_n, touches_mm, noise, creep;
  double inside_force = 0, inside_touch = 0, heaviest_n = 0;
  for (const Plateau& plateau : result.plateaus) {
    errors_n.push_back(std::abs(plateau.found_n - plateau.force_n));
    touches_mm.push_back(touch_error_mm(plateau));
    noise.push_back(plateau.noise_n);
    inside_force += errors_n.back() <= plateau.sigma_n;
    inside_touch += touches_mm.back() <= plateau.radius_mm;
    heaviest_n = std::max(heaviest_n, plateau.force_n);
    if (plateau.lasted_s >= kLongHold_s) creep.push_back(100 * std::abs(plateau.drift_n) / plateau.force_n);
  }
  const auto count = static_cast<double>(result.plateaus.size());
  const auto of_seen = [&](double value) { return count > 0 ? std::optional(value) : std::nullopt; };
  const auto add = [&](const char* name, const char* clause, const char* unit, std::optional<double> value,
                       std::optional<double> limit, bool at_least = false) {
    result.checks.push_back({name, clause, unit, value, limit, at_least});
  };
  add("force error, mean", "NIST SP 1227 draft, 9", "% of the heaviest", of_seen(100 * mean_of(errors_n) / heaviest_n),
      limits.force_error_percent);
  add("force, expanded uncertainty (k = 2)", "GUM 6.2; ISO 376 annex C", "N", of_seen(result.force_expanded_n),
      limits.force_expanded_n);
  add("touch error, mean", "NIST SP 1227 draft, touch", "mm", of_seen(mean_of(touches_mm)), limits.touch_mean_mm);
  add("touch, expanded uncertainty (k = 2)", "GUM 6.2", "mm", of_seen(result.touch_expanded_mm),
      limits.touch_expanded_mm);
  add("repeatability", "ISO 376, 7.5.1", "%", scaled(largest(differences(result.plateaus, true)), 100),
      limits.repeatability_percent);
  add("zero return", "ISO 376, 7.5.3", "mm", largest(zero_returns_mm(readings)), limits.zero_return_mm);
  add("hysteresis (up against down)", "ISO 376, 7.5.4", "%", scaled(largest(differences(result.plateaus, false)), 100),
      limits.hysteresis_percent);
  add("creep over the longest hold", "ISO 376, 7.5.5", "%", largest(creep), limits.creep_percent);
  add("detection threshold: detected from here on", "NIST SP 1227 draft, touch sensitivity", "N",
      detection_threshold_n(result), limits.detection_n);
  const double hung = count + static_cast<double>(result.missed.size());
  add(kAllDetected, "NIST SP 1227 draft, touch sensitivity", "%", 100 * count / hung,
      limits.detection_n ? std::nullopt : std::optional(100.0), true);
  add("resolution (twice the readings' scatter)", "ISO 376, 7.2", "N", of_seen(2 * mean_of(noise)), std::nullopt);
  add("forces inside the stated deviation", "GUM 6.3", "", of_seen(inside_force / count), limits.coverage_68, true);
  add("touches inside the stated radius", "GUM 6.3", "", of_seen(inside_touch / count), limits.coverage_68, true);
}

/// Judges by what the recordings tell.
void leave_untold(const VerificationPlan& plan, Verification& result) {
  for (Check& check : result.checks) {
    if (!check.value) check.limit.reset();
  }
  const auto is_of_plan = [](const Check& check) { return check.limit && check.name != kAllDetected; };
  if (std::ranges::any_of(result.checks, is_of_plan)) return;
  throw InputError(plan.series.front().where, "limits", "none that these recordings tell anything of", "one or more");
}

}  // namespace

VerificationPlan read_plan(const std::filesystem::path& file, int holes) {
  TomlTable root = TomlTable::parse_file(file);
  VerificationPlan plan;
  plan.finger = root.text("finger", "");
  for (TomlTable& table : root.tables("series")) {
    PlannedSeries series;
    series.where = table.where();
    series.session = table.text("session");
    series.hole = static_cast<int>(table.integer("hole", 1, holes));
    series.mass_g = table.numbers("mass_g", 0, 1, 5000);
    if (series.mass_g.empty()) throw InputError(table.where("mass_g"), "mass_g", "no weight", "one or more");
    table.finish();
    plan.series.push_back(std::move(series));
  }
  if (root.has("limits")) {
    TomlTable table = root.table("limits");
    VerificationLimits& limits = plan.limits;
    limits.force_error_percent = optional_limit(table, "force_error_percent", 100);
    limits.force_expanded_n = optional_limit(table, "force_expanded_n", 1000);
    limits.touch_mean_mm = optional_limit(table, "touch_mean_mm", 100);
    limits.touch_expanded_mm = optional_limit(table, "touch_expanded_mm", 100);
    limits.repeatability_percent = optional_limit(table, "repeatability_percent", 100);
    limits.hysteresis_percent = optional_limit(table, "hysteresis_percent", 100);
    limits.creep_percent = optional_limit(table, "creep_percent", 100);
    limits.zero_return_mm = optional_limit(table, "zero_return_mm", 100);
    limits.detection_n = optional_limit(table, "detection_n", 1000);
    limits.coverage_68 = optional_limit(table, "coverage_68", 1);
    table.finish();
  }
  root.finish();
  if (plan.limits == VerificationLimits{}) throw InputError(file.string(), "limits", "none", "one or more to judge by");
  return plan;
}

Verification verify(const VerificationPlan& plan, const std::vector<JigHole>& holes,
                    const std::vector<std::vector<TouchReading>>& readings, const VerificationKind& kind) {
  Verification result;
  for (std::size_t i = 0; i < plan.series.size(); ++i) {
    const PlannedSeries& series = plan.series[i];
    const auto hole = std::ranges::find(holes, series.hole, &JigHole::number);
    add_series(series, *hole, readings[i], result);
  }
  make_budget(kind, result);
  make_checks(plan.limits, readings, result);
  if (kind.is_quick) leave_untold(plan, result);
  result.passed = std::ranges::all_of(result.checks, &Check::passes);
  return result;
}

}  // namespace finsight::host
