#include "firmware/settings/measured_fit.h"

#include <doctest/doctest.h>

#include "firmware/input_error.h"

using namespace finsight;

namespace {

FitValues example() {
  FitValues fit;
  fit.model_checksum = 0x0123ABCD;
  fit.fitted_on = days_of(20261123);
  fit.force_scale = 0.93F;
  fit.force_scale_sigma = 0.02F;
  fit.force_sigma = 0.05F;
  fit.creep_share = 0.08F;
  fit.creep_s = 22;
  fit.force_slope = {0.01F, -0.12F, 0.03F};
  fit.hysteresis = 0.06F;
  fit.force_range_n = 6;
  fit.across_mm = {0.1F, -0.2F, 0, 0.05F};
  fit.along_mm = {1.1F, 0.3F, -0.4F, 0.5F};
  fit.motion_change(0, 3) = 0.25F;
  fit.motion_change(17, 16) = -0.0123F;
  fit.face_middle_mm = Vec3f(0, 60, -15);
  fit.face_half_mm = {23, 47};
  fit.touch_radius_mm = 0.6F;
  fit.noise_per_mm = 0.25F;
  fit.explained_lower = 3.5F;
  return fit;
}

std::string refusal(const std::string& text) {
  try {
    read_measured_fit(TomlTable::parse_text(text, "fit.toml"));
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

std::string replaced(const std::string& what, const std::string& with) {
  std::string text = measured_fit_toml(example());
  return text.replace(text.find(what), what.size(), with);
}

}  // namespace

TEST_CASE("measured fit: what was written is read again") {
  const FitValues fit = read_measured_fit(TomlTable::parse_text(measured_fit_toml(example()), "fit.toml"));
  CHECK(fit.model_checksum == 0x0123ABCD);
  CHECK(fit.fitted_on == example().fitted_on);
  CHECK(fit.force_scale == doctest::Approx(0.93));
  CHECK(fit.creep_s == doctest::Approx(22));
  CHECK(fit.force_slope == example().force_slope);
  CHECK(fit.hysteresis == doctest::Approx(0.06));
  CHECK(fit.force_range_n == 6);
  CHECK(fit.along_mm == example().along_mm);
  CHECK(fit.motion_change == example().motion_change);
  CHECK(fit.face_middle_mm == example().face_middle_mm);
  CHECK(fit.touch_radius_mm == doctest::Approx(0.6));
  CHECK(fit.noise_per_mm == 0.25F);
  CHECK(fit.explained_lower == 3.5F);
}

TEST_CASE("measured fit: days are counted from 2000-01-01, and nothing else is a day") {
  CHECK(days_of(20000102) == 1);
  CHECK(days_of(20261123) == 9823);
  CHECK(date_of(9823) == 20261123);
  CHECK(date_of(0) == 0);
  for (const std::int64_t date :
       {std::int64_t{0}, std::int64_t{20260230}, std::int64_t{19991231}, std::int64_t{20261301}}) {
    CHECK(days_of(date) == 0);
  }
}

TEST_CASE("measured fit: each wrong value is refused by its name") {
  CHECK(refusal(replaced("force_scale = 0.93", "force_scale = 0")).find("force_scale") != std::string::npos);
  CHECK(refusal(replaced("date = 20261123", "date = 20261323")).find("date") != std::string::npos);
  CHECK(refusal(replaced("0123abcd", "0123abc")).find("model") != std::string::npos);
  CHECK(refusal(replaced("creep_s = 22", "creep_s = 0")).find("creep_s") != std::string::npos);
  CHECK(refusal(replaced("hysteresis = 0.06", "hysteresis = 3")).find("hysteresis") != std::string::npos);
  CHECK(refusal(replaced("hysteresis = 0.06", "hysteresis = 0.2")).find("hysteresis") != std::string::npos);
  CHECK(refusal(replaced("along_mm = [1.1, ", "along_mm = [")).find("along_mm") != std::string::npos);
  CHECK(refusal(replaced("motion_change = [0, ", "motion_change = [")).find("motion_change") != std::string::npos);
  CHECK(refusal(replaced("0.25", "250")).find("motion_change") != std::string::npos);
  CHECK(refusal(measured_fit_toml(example()) + "speed = 1\n").find("speed") != std::string::npos);
}

TEST_CASE("measured fit: one made with another pack is refused") {
  CHECK_NOTHROW(check_fit(example(), 0x0123ABCD, "board.toml:3"));
  CHECK_THROWS_WITH_AS(check_fit(example(), 1, "board.toml:3"), doctest::Contains("fit the finger again"), InputError);
}

TEST_CASE("measured fit: without a change of motions they stay as they are") {
  FitValues fit = example();
  fit.motion_change.setZero();
  const std::string text = measured_fit_toml(fit);
  CHECK(text.find("motion_change") == std::string::npos);
  CHECK(read_measured_fit(TomlTable::parse_text(text, "fit.toml")).motion_change.isZero(0));
}
