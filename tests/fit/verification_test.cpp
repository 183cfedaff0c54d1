#include "hostgen/fit/verification.h"

#include <doctest/doctest.h>
#include <unistd.h>

#include <nlohmann/json.hpp>

#include "firmware/input_error.h"
#include "hostgen/util/common.h"
#include "hostgen/util/random.h"

using namespace finsight;
using namespace finsight::host;

namespace {

const std::vector<JigHole>& holes() {
  static const std::vector<JigHole> two = {{.number = 1, .contact_mm = {0, 40, 0}, .inward = {0, 0, 1}},
                                           {.number = 2, .contact_mm = {10, 80, 0}, .inward = {0, 0, 1}}};
  return two;
}

struct Device {
  double scale = 1, up_mm = 0.2, hysteresis = 0.01, rest_mm = 0.05, sigma_n = 0.15, radius_mm = 0.5;
};

/// Two seconds at each weight, then a second without any.
std::vector<TouchReading> readings_of(const PlannedSeries& series, const Device& device) {
  Random random(7);
  std::vector<TouchReading> readings;
  const Vec3f at_mm = holes()[static_cast<std::size_t>(series.hole - 1)].contact_mm.cast<float>();
  const auto add = [&](double force_n, int count) {
    for (int i = 0; i < count; ++i) {
      TouchReading reading{.time_s = static_cast<double>(readings.size()) / 60};
      reading.is_valid = force_n > 0;
      reading.plate_motion_mm = static_cast<float>(force_n > 0 ? 4 : device.rest_mm);
      if (reading.is_valid) {
        reading.force_n = force_n + 0.02 * random.normal();
        reading.point_mm = at_mm + Vec3f(0, static_cast<float>(device.up_mm + 0.05 * random.normal()), 0);
        reading.force_sigma_n = device.sigma_n;
        reading.radius_mm = device.radius_mm;
      }
      readings.push_back(reading);
    }
  };
  add(0, 60);
  double before_g = 0;
  for (const double mass_g : series.mass_g) {
    const double force_n = 9.80665e-3 * mass_g * device.scale;
    add(mass_g < before_g ? force_n * (1 + device.hysteresis) : force_n, 120);
    before_g = mass_g;
  }
  add(0, 60);
  return readings;
}

VerificationPlan plan() {
  VerificationPlan plan;
  plan.finger = "F-<7>";
  plan.series = {{.session = "a", .hole = 1, .mass_g = {200, 300, 400, 300, 200}, .where = "plan.toml:2"},
                 {.session = "b", .hole = 2, .mass_g = {200, 300, 400, 300, 200}, .where = "plan.toml:6"}};
  plan.limits.force_error_percent = 5;
  plan.limits.touch_mean_mm = 1;
  plan.limits.hysteresis_percent = 5;
  plan.limits.zero_return_mm = 0.3;
  plan.limits.coverage_68 = 0.6;
  return plan;
}

Verification verified(const Device& device) {
  std::vector<std::vector<TouchReading>> readings;
  for (const PlannedSeries& series : plan().series) readings.push_back(readings_of(series, device));
  return verify(plan(), holes(), readings);
}

const Check& check(const Verification& verification, const std::string& name) {
  for (const Check& found : verification.checks) {
    if (found.name.starts_with(name)) return found;
  }
  throw std::runtime_error(name);
}

}  // namespace

TEST_CASE("verification: a good finger passes, each weight found in its order") {
  const Verification result = verified({});
  CHECK(result.passed);
  REQUIRE(result.plateaus.size() == 10);
  CHECK(result.plateaus[2].found_n == doctest::Approx(3.92).epsilon(0.01));
  CHECK(!result.plateaus[2].is_down);
  CHECK(result.plateaus[3].is_down);
  CHECK(*check(result, "hysteresis").value == doctest::Approx(1).epsilon(0.4));
  CHECK(*check(result, "zero return").value == doctest::Approx(0.05));
  CHECK(!check(result, "creep").value);  // no weight hung for a minute
  CHECK(result.force_expanded_n > 0.02);
}

TEST_CASE("verification: fingers that should fail do, each by its own line") {
  const auto fails_by = [](const Device& device, const std::string& name) {
    const Verification result = verified(device);
    return !result.passed && !check(result, name).passes();
  };
  CHECK(fails_by({.scale = 1.15}, "force error"));
  CHECK(fails_by({.up_mm = 1.6}, "touch error"));
  CHECK(fails_by({.hysteresis = 0.09}, "hysteresis"));
  CHECK(fails_by({.rest_mm = 0.8}, "zero return"));
  CHECK(fails_by({.radius_mm = 0.1}, "touches inside"));
  CHECK(fails_by({.scale = 1.04, .sigma_n = 0.01}, "forces inside"));
}

TEST_CASE("verification: what a limit asks for and the recordings do not tell does not pass") {
  VerificationPlan strict = plan();
  strict.limits.creep_percent = 3;
  std::vector<std::vector<TouchReading>> readings;
  for (const PlannedSeries& series : strict.series) readings.push_back(readings_of(series, {}));
  CHECK(!verify(strict, holes(), readings).passed);
}

TEST_CASE("verification: a step that is missing is named with the plan's line") {
  VerificationPlan other = plan();
  const std::vector<std::vector<TouchReading>> readings = {readings_of(other.series[0], {}),
                                                           readings_of(other.series[1], {})};
  other.series[1].mass_g.push_back(100);
  CHECK_THROWS_WITH_AS(verify(other, holes(), readings), doctest::Contains("plan.toml:6: b: weights at rest: found 5"),
                       InputError);
}

TEST_CASE("verification: certificate and figures say the same, and names are not taken for HTML") {
  const Verification result = verified({.scale = 1.15});
  const nlohmann::json figures = verification_json(plan(), result, 20261123);
  CHECK(figures["passed"] == false);
  CHECK(figures["date"] == "2026-11-23");
  CHECK(figures["weights"].size() == 10);
  const std::string page = certificate_html(plan(), result, 20261123, "0123abcd", "finsightctl");
  CHECK(page.find("F-&lt;7&gt;") != std::string::npos);
  CHECK(page.find("<7>") == std::string::npos);
  CHECK(page.find(">Failed<") != std::string::npos);
}

TEST_CASE("verification: a plan is read strictly") {
  const auto file = std::filesystem::temp_directory_path() / ("plan" + std::to_string(getpid()) + ".toml");
  const auto refusal = [&](const std::string& text) -> std::string {
    write_file_atomically(file, text);
    try {
      read_plan(file, 9);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  };
  const std::string good =
      "finger = \"7\"\n[[series]]\nsession = \"a\"\nhole = 5\nmass_g = [200, 300]\n[limits]\ntouch_mean_mm = 1\n";
  CHECK(refusal(good).empty());
  CHECK(refusal("finger = \"7\"\n").find("series") != std::string::npos);
  CHECK(refusal(good + "speed = 1\n").find("speed") != std::string::npos);
  CHECK(refusal("[[series]]\nsession = \"a\"\nhole = 12\nmass_g = [1]\n").find("hole") != std::string::npos);
  CHECK(refusal("[[series]]\nsession = \"a\"\nhole = 1\nmass_g = []\n").find("mass_g") != std::string::npos);
}
