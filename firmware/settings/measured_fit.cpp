#include "firmware/settings/measured_fit.h"

#include <algorithm>
#include <chrono>
#include <cstdio>

#include "firmware/input_error.h"
#include "firmware/model/model.h"

namespace finsight {

namespace {

using namespace std::chrono;

constexpr sys_days kFirstDay = 2000y / January / 1;
constexpr double kLargestOffset_mm = 20;
constexpr double kLargestChange = 100;  // mm and rad, per mm and per rad

std::array<float, FitValues::kTerms> read_terms(TomlTable& table, const char* key) {
  const std::vector<double> numbers = table.numbers(key, FitValues::kTerms, -kLargestOffset_mm, kLargestOffset_mm);
  std::array<float, FitValues::kTerms> terms;
  for (std::size_t i = 0; i < terms.size(); ++i) terms[i] = static_cast<float>(numbers[i]);
  return terms;
}

float read_number(TomlTable& table, const char* key, double lowest, double highest) {
  return static_cast<float>(table.number(key, lowest, highest));
}

/// `per_line` of them in a line, or all.
void add_numbers(std::string& text, const char* key, std::span<const float> numbers, std::size_t per_line = SIZE_MAX) {
  text.append(key).append(" = [");
  char number[32];
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const char* before = i == 0 ? "" : i % per_line == 0 ? ",\n  " : ", ";
    std::snprintf(number, sizeof number, "%s%.6g", before, static_cast<double>(numbers[i]));
    text += number;
  }
  text += "]\n";
}

}  // namespace

std::uint16_t days_of(std::int64_t date) {
  if (date < 2000'01'01 || date > 2179'12'31) return 0;
  const year_month_day day(year(static_cast<int>(date / 10000)), month(static_cast<unsigned>(date / 100 % 100)),
                           std::chrono::day(static_cast<unsigned>(date % 100)));
  return day.ok() ? static_cast<std::uint16_t>((sys_days(day) - kFirstDay).count()) : 0;
}

std::uint32_t date_of(std::uint16_t days_since) {
  if (days_since == 0) return 0;
  const year_month_day day(kFirstDay + days(days_since));
  return static_cast<std::uint32_t>(int{day.year()}) * 10000 + unsigned{day.month()} * 100 + unsigned{day.day()};
}

std::uint16_t day_today() { return static_cast<std::uint16_t>((floor<days>(system_clock::now()) - kFirstDay).count()); }

FitValues read_measured_fit(TomlTable table) {
  FitValues fit;
  const std::string model = table.text("model");
  for (const char digit : model) {
    const auto value = std::string_view("0123456789abcdef").find(digit);
    if (model.size() != 8 || value == std::string_view::npos) {
      throw InputError(table.where("model"), "model", "\"" + model + "\"", "a pack's checksum, eight digits 0 to f");
    }
    fit.model_checksum = fit.model_checksum << 4 | static_cast<std::uint32_t>(value);
  }
  const std::int64_t date = table.integer("date", 0, 2179'12'31);
  fit.fitted_on = days_of(date);
  if (fit.fitted_on == 0) throw InputError(table.where("date"), "date", std::to_string(date), "a day such as 20261123");
  fit.force_scale = read_number(table, "force_scale", 0.1, 10);
  fit.force_scale_sigma = read_number(table, "force_scale_sigma", 0, 1);
  if (table.has("force_slope")) {
    std::ranges::transform(table.numbers("force_slope", fit.force_slope.size(), -1, 1), fit.force_slope.begin(),
                           [](double slope) { return static_cast<float>(slope); });
  }
  fit.force_sigma = read_number(table, "force_sigma", 0, 1);
  if (table.has("creep_share") || table.has("creep_s")) {
    fit.creep_share = read_number(table, "creep_share", 0, 1);
    fit.creep_s = read_number(table, "creep_s", 0.1, 10'000);
  }
  if (table.has("hysteresis") || table.has("force_range_n")) {
    // From about 0.25 on a force could bend the material less than a smaller one: no force follows from the bend.
    fit.hysteresis = read_number(table, "hysteresis", 0, 0.15);
    fit.force_range_n = read_number(table, "force_range_n", 0.01, 10'000);
  }
  fit.across_mm = read_terms(table, "across_mm");
  fit.along_mm = read_terms(table, "along_mm");
  if (table.has("motion_change")) {
    const std::vector<double> change = table.numbers(
        "motion_change", static_cast<std::size_t>(fit.motion_change.size()), -kLargestChange, kLargestChange);
    std::ranges::transform(change, fit.motion_change.data(), [](double number) { return static_cast<float>(number); });
  }
  const std::vector<double> middle = table.numbers("face_middle_mm", 3, -1000, 1000);
  fit.face_middle_mm = Eigen::Vector3d(middle[0], middle[1], middle[2]).cast<float>();
  const std::vector<double> half = table.numbers("face_half_mm", 2, 1, 1000);
  fit.face_half_mm = {static_cast<float>(half[0]), static_cast<float>(half[1])};
  fit.touch_radius_mm = read_number(table, "touch_radius_mm", 0, 100);
  if (table.has("noise_per_mm")) fit.noise_per_mm = read_number(table, "noise_per_mm", 0, 10);
  if (table.has("explained_lower")) fit.explained_lower = read_number(table, "explained_lower", 0, 1000);
  table.finish();
  return fit;
}

std::string measured_fit_toml(const FitValues& fit) {
  char line[160];
  std::string text;
  const auto add = [&](const char* key, float value, const char* note) {
    std::snprintf(line, sizeof line, "%s = %.6g  # %s\n", key, static_cast<double>(value), note);
    text += line;
  };
  text += "model = \"" + checksum_text(fit.model_checksum) + "\"  # of the pack that it was measured with\n";
  text += "date = " + std::to_string(date_of(fit.fitted_on)) + "\n";
  add("force_scale", fit.force_scale, "force over what the pack says, in the middle of the face");
  add("force_scale_sigma", fit.force_scale_sigma, "its standard deviation");
  text += "# Its logarithm grows by s0 u + s1 v + s2 v^2, u and v from -1 to 1 over the face.\n";
  add_numbers(text, "force_slope", fit.force_slope);
  add("force_sigma", fit.force_sigma, "relative standard deviation of a force that remains");
  if (fit.creep_share > 0) {
    add("creep_share", fit.creep_share, "how much further a lasting force bends the finger in the end");
    add("creep_s", fit.creep_s, "time constant of that");
  }
  if (fit.hysteresis > 0) {
    add("hysteresis", fit.hysteresis, "widest gap between a growing and a falling force, of force_range_n");
    add("force_range_n", fit.force_range_n, "of the finger");
  }
  if (!fit.motion_change.isZero(0)) {
    text += "# This times the plates' motion is added to it: walls, markers and camera.\n";
    add_numbers(text, "motion_change", std::span(fit.motion_change.data(), fit.motion_change.size()), kPoseDims);
  }
  text += "# How far touches are seen beside their place: c0 + c1 u + c2 v + c3 v^2.\n";
  add_numbers(text, "across_mm", fit.across_mm);
  add_numbers(text, "along_mm", fit.along_mm);
  add_numbers(text, "face_middle_mm", std::span(fit.face_middle_mm.data(), 3));
  add_numbers(text, "face_half_mm", fit.face_half_mm);
  add("touch_radius_mm", fit.touch_radius_mm, "68 % of the touches' offsets that remain are smaller");
  add("noise_per_mm", fit.noise_per_mm, "each mm of plate motion counts as so many times the noise");
  if (fit.explained_lower > 0) {
    add("explained_lower", fit.explained_lower, "log-odds by which its touches may be less like the pack's");
  }
  return text;
}

void check_fit(const FitValues& fit, std::uint32_t model_checksum, const std::string& where) {
  if (fit.model_checksum == model_checksum) return;
  throw InputError(where, "fit.model", checksum_text(fit.model_checksum),
                   checksum_text(model_checksum) + ", the pack's; fit the finger again with it");
}

}  // namespace finsight
