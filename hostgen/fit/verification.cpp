#include "hostgen/fit/verification.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "firmware/input_error.h"
#include "hostgen/util/gravity.h"
#include "hostgen/util/statistics.h"

namespace finsight::host {

namespace {

constexpr double kStep_s = 0.7;  // from one weight to the next, at most, and until it has come to rest
constexpr double kShortestPlateau_s = 1;
constexpr double kLongHold_s = 60;  // from which on creep is stated
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

std::vector<Plateau> plateaus_of(const PlannedSeries& series, const JigHole& hole,
                                 const std::vector<TouchReading>& readings) {
  const std::vector<Stretch> stretches = plateaus_in(readings);
  if (stretches.size() != series.mass_g.size()) {
    throw InputError(series.where, series.session + ": weights at rest", std::to_string(stretches.size()),
                     std::to_string(series.mass_g.size()) +
                         " as planned; a weight that is too light for its hole "
                         "shows no touch, and each has to rest for a second");
  }
  std::vector<Plateau> plateaus;
  for (std::size_t i = 0; i < stretches.size(); ++i) {
    Plateau plateau = plateau_of(readings, stretches[i]);
    plateau.session = series.session;
    plateau.hole = series.hole;
    plateau.force_n = weight_n(series.mass_g[i]);
    plateau.is_down = i > 0 && series.mass_g[i] < series.mass_g[i - 1];
    plateau.truth_mm = hole.contact_mm.cast<float>();
    plateaus.push_back(plateau);
  }
  return plateaus;
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

// GUM: standard deviations of the parts, added in squares. Parts that were not seen in the recordings count with what
// the device itself states.
void make_budget(Verification& result) {
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
  const auto rms = [](const std::vector<double>& numbers) {
    double sum = 0;
    for (const double number : numbers) sum += number * number;
    return numbers.empty() ? 0 : std::sqrt(sum / static_cast<double>(numbers.size()));
  };
  const auto add = [&](const char* source, const char* how, double force_n, double touch_mm) {
    result.budget.push_back({source, how, force_n, touch_mm});
  };
  add("camera", "scatter of single readings", mean_of(noise), 0);
  add("lens, mount, model", "errors of all weights, RMS", rms(force_errors), std::hypot(rms(x), rms(y)));
  add("hysteresis", "half of up minus down, even distribution",
      up_down.empty() ? 0 : mean_of(up_down) * heaviest_n / 2 / std::sqrt(3.0), 0);
  if (drifts.empty())
    add("creep", "no hold of a minute: a fifth of the stated deviation", 0.2 * mean_of(stated_n), 0);
  else
    add("creep", "drift of the longest holds, even distribution", mean_of(drifts) / std::sqrt(3.0), 0);
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

void make_checks(const VerificationLimits& limits, const std::vector<std::vector<TouchReading>>& readings,
                 Verification& result) {
  std::vector<double> errors_n, touches_mm, noise, creep;
  double inside_force = 0, inside_touch = 0, heaviest_n = 0, lightest_n = 1e9;
  for (const Plateau& plateau : result.plateaus) {
    errors_n.push_back(std::abs(plateau.found_n - plateau.force_n));
    touches_mm.push_back(touch_error_mm(plateau));
    noise.push_back(plateau.noise_n);
    inside_force += errors_n.back() <= plateau.sigma_n;
    inside_touch += touches_mm.back() <= plateau.radius_mm;
    heaviest_n = std::max(heaviest_n, plateau.force_n);
    lightest_n = std::min(lightest_n, plateau.force_n);
    if (plateau.lasted_s >= kLongHold_s) creep.push_back(100 * std::abs(plateau.drift_n) / plateau.force_n);
  }
  const auto count = static_cast<double>(result.plateaus.size());
  const auto add = [&](const char* name, const char* clause, const char* unit, std::optional<double> value,
                       std::optional<double> limit, bool at_least = false) {
    result.checks.push_back({name, clause, unit, value, limit, at_least});
  };
  add("force error, mean", "", "% of the heaviest", 100 * mean_of(errors_n) / heaviest_n, limits.force_error_percent);
  add("force, expanded uncertainty (k = 2)", "GUM; ISO 376 annex C", "N", result.force_expanded_n,
      limits.force_expanded_n);
  add("touch error, mean", "NIST SP 1227, touch", "mm", mean_of(touches_mm), limits.touch_mean_mm);
  add("touch, expanded uncertainty (k = 2)", "GUM", "mm", result.touch_expanded_mm, limits.touch_expanded_mm);
  add("repeatability", "ISO 376, 7.5.1", "%", scaled(largest(differences(result.plateaus, true)), 100),
      limits.repeatability_percent);
  add("zero return", "ISO 376, 7.5.3", "mm", largest(zero_returns_mm(readings)), limits.zero_return_mm);
  add("hysteresis (up against down)", "ISO 376, 7.5.4", "%", scaled(largest(differences(result.plateaus, false)), 100),
      limits.hysteresis_percent);
  add("creep over the longest hold", "ISO 376, 7.5.5", "%", largest(creep), limits.creep_percent);
  add("lightest weight that was detected", "NIST SP 1227, touch sensitivity", "N", lightest_n, std::nullopt);
  add("resolution (twice the readings' scatter)", "ISO 376, 7.2", "N", 2 * mean_of(noise), std::nullopt);
  add("forces inside the stated deviation", "", "", inside_force / count, limits.coverage_68, true);
  add("touches inside the stated radius", "", "", inside_touch / count, limits.coverage_68, true);
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
    limits.coverage_68 = optional_limit(table, "coverage_68", 1);
    table.finish();
  }
  root.finish();
  return plan;
}

Verification verify(const VerificationPlan& plan, const std::vector<JigHole>& holes,
                    const std::vector<std::vector<TouchReading>>& readings) {
  Verification result;
  for (std::size_t i = 0; i < plan.series.size(); ++i) {
    const PlannedSeries& series = plan.series[i];
    const auto hole = std::ranges::find(holes, series.hole, &JigHole::number);
    const std::vector<Plateau> found = plateaus_of(series, *hole, readings[i]);
    result.plateaus.insert(result.plateaus.end(), found.begin(), found.end());
  }
  make_budget(result);
  make_checks(plan.limits, readings, result);
  result.passed = std::ranges::all_of(result.checks, &Check::passes);
  return result;
}

}  // namespace finsight::host
