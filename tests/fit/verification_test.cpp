#include "hostgen/fit/verification.h"

#include <doctest/doctest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
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

TEST_CASE("verification: a quick check judges by what its recordings tell, and writes no verification") {
  VerificationPlan daily = plan();
  daily.limits.creep_percent = 3;
  daily.series.resize(1);
  const std::vector<std::vector<TouchReading>> readings = {readings_of(daily.series[0], {})};
  CHECK(!verify(daily, holes(), readings).passed);
  const Verification quick = verify(daily, holes(), readings, {.is_quick = true});
  CHECK(quick.passed);
  CHECK(verification_json(daily, quick, {.date = 20261123, .is_quick = true})["settings"].empty());
  daily.limits = {};
  daily.limits.creep_percent = 3;
  CHECK_THROWS_WITH_AS(verify(daily, holes(), readings, {.is_quick = true}),
                       doctest::Contains("none that these recordings tell"), InputError);
}

TEST_CASE("verification: weights too light to be seen fail, or set the threshold from which on they are") {
  VerificationPlan light = plan();
  light.series = {{.session = "a", .hole = 1, .mass_g = {200, 300, 200}, .where = "plan.toml:2"}};
  const std::vector<std::vector<TouchReading>> readings = {readings_of(light.series[0], {})};
  light.series[0].mass_g = {50, 200, 300, 200, 50};
  const Verification result = verify(light, holes(), readings);
  CHECK(!result.passed);
  REQUIRE(result.missed.size() == 2);
  CHECK(result.missed[1].force_n == doctest::Approx(0.49).epsilon(0.01));
  CHECK(check(result, "detection threshold").value == doctest::Approx(1.96).epsilon(0.01));
  CHECK(result.plateaus[1].found_n == doctest::Approx(2.94).epsilon(0.01));
  CHECK(result.plateaus[2].is_down);
  light.limits.detection_n = 2;
  CHECK(verify(light, holes(), readings).passed);
  light.limits.detection_n = 1.5;
  CHECK(!verify(light, holes(), readings).passed);
}

TEST_CASE("verification: a finger that shows no weight at all fails, with a certificate") {
  std::vector<std::vector<TouchReading>> readings;
  for (const PlannedSeries& series : plan().series) {
    readings.push_back(readings_of(series, {}));
    for (TouchReading& reading : readings.back()) reading.is_valid = false;
  }
  const Verification result = verify(plan(), holes(), readings);
  CHECK(!result.passed);
  CHECK(result.missed.size() == 10);
  CHECK(!check(result, "force error").value);
  CHECK(certificate_html(plan(), result, {.date = 20261123}, "").find("not detected") != std::string::npos);
}

TEST_CASE("verification: the budget tells stiffness, lens, mount and model apart, and adds up to the errors") {
  std::vector<std::vector<TouchReading>> readings;
  for (const PlannedSeries& series : plan().series) {
    readings.push_back(readings_of(series, {.scale = 1.04}));
    for (TouchReading& reading : readings.back()) {
      for (PlateMotion& plate : reading.poses.plates) plate.displacement_mm = Vec3f(0, -1, 3);
    }
  }
  VerificationKind kind;
  kind.R_finger_camera << 1, 0, 0, 0, 0, 1, 0, -1, 0;
  kind.read_poses = [](const PlatePoses& poses) {
    const Vec3f& moved = poses.plates[0].displacement_mm;
    return ForceAndPlace{static_cast<double>(moved.z()), Vec3f(0, 20 * moved.y(), 0)};
  };
  const Verification result = verify(plan(), holes(), readings, kind);
  double errors_sq = 0;
  for (const BudgetLine& line : result.budget) {
    if (line.source == "lens") CHECK(line.touch_mm == doctest::Approx(20 * 0.01 / std::sqrt(3.0)).epsilon(0.01));
    if (line.source == "mount") CHECK(line.touch_mm > 0.1);  // no more than the lens leaves of what was seen
    if (line.source == "material, stiffness") CHECK(line.force_n == doctest::Approx(0.04 * 2.83).epsilon(0.1));
    if (line.source != "lens" && line.source != "mount" && line.source != "model" &&
        line.source != "material, stiffness")
      continue;
    errors_sq += line.force_n * line.force_n;
  }
  double seen_sq = 0;
  for (const Plateau& plateau : result.plateaus) {
    seen_sq += (plateau.found_n - plateau.force_n) * (plateau.found_n - plateau.force_n) / 10;
  }
  CHECK(errors_sq == doctest::Approx(seen_sq));
}

TEST_CASE("verification: a step that is missing is named with the plan's line") {
  VerificationPlan other = plan();
  const std::vector<std::vector<TouchReading>> readings = {readings_of(other.series[0], {}),
                                                           readings_of(other.series[1], {})};
  other.series[1].mass_g.push_back(600);
  CHECK_THROWS_WITH_AS(verify(other, holes(), readings), doctest::Contains("plan.toml:6: b: weights at rest: found 5"),
                       InputError);
}

TEST_CASE("verification: certificate and figures say the same, and names are not taken for HTML") {
  const Verification result = verified({.scale = 1.15});
  const nlohmann::json figures = verification_json(plan(), result, {.date = 20261123});
  CHECK(figures["passed"] == false);
  CHECK(figures["date"] == "2026-11-23");
  CHECK(figures["weights"].size() == 10);
  CHECK(figures["settings"]["verdict"] == "failed");
  const CertificateHead head{.date = 20261123, .pack = "0123abcd", .fit = "fit<7>.toml", .mount = "as drawn"};
  const std::string page = certificate_html(plan(), result, head, "finsightctl");
  CHECK(page.find("F-&lt;7&gt;") != std::string::npos);
  CHECK(page.find("<7>") == std::string::npos);
  CHECK(page.find(">Failed<") != std::string::npos);
}

TEST_CASE("verification: the plan that comes with srm is a whole one") {
  const VerificationPlan whole = read_plan(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.plan.toml", 9);
  for (int hole = 1; hole <= 9; ++hole) {
    const auto series = std::ranges::find(whole.series, hole, &PlannedSeries::hole);
    REQUIRE(series != whole.series.end());
    CHECK(series->mass_g.size() == 5);
  }
  CHECK(whole.series.back().mass_g.size() == 1);
  CHECK(whole.limits.creep_percent);
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
  CHECK(refusal(good.substr(0, good.find("[limits]"))).find("limits: found none") != std::string::npos);
  CHECK(refusal("[[series]]\nsession = \"a\"\nhole = 12\nmass_g = [1]\n").find("hole") != std::string::npos);
  CHECK(refusal("[[series]]\nsession = \"a\"\nhole = 1\nmass_g = []\n").find("mass_g") != std::string::npos);
}
