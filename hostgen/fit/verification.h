// Is a finger as right as it says? Known weights, up and down, at the holes of its jig, in the manner of a load cell's
// calibration (ISO 376:2011, clause 7.5) and of touch tests of robot hands (NIST SP 1227), as far as they fit a finger
// that also says where it is touched.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "firmware/settings/toml_table.h"
#include "hostgen/finger/jig_holes.h"
#include "hostgen/fit/touch_reading.h"

namespace finsight::host {

/// Weights one after the other at one hole, in one recording that begins with the untouched finger.
struct PlannedSeries {
  std::string session;  ///< name of the recording's folder
  int hole = 0;
  std::vector<double> mass_g;  ///< in their order
  std::string where;           ///< in the plan, for messages
};

/// The worst that passes. Nothing: no limit.
struct VerificationLimits {
  std::optional<double> force_error_percent;  ///< of the largest weight: mean of the absolute errors
  std::optional<double> force_expanded_n;     ///< expanded uncertainty, k = 2
  std::optional<double> touch_mean_mm, touch_expanded_mm;
  std::optional<double> repeatability_percent, hysteresis_percent, creep_percent;
  std::optional<double> zero_return_mm;
  std::optional<double> coverage_68;  ///< the least that passes, of forces and of touches
};

struct VerificationPlan {
  std::string finger;  ///< serial number or name, for the certificate
  std::vector<PlannedSeries> series;
  VerificationLimits limits;
};

/// Strict: throws InputError like TomlTable. Holes 1 to `holes`.
VerificationPlan read_plan(const std::filesystem::path& file, int holes);

/// A weight at rest.
struct Plateau {
  std::string session;
  int hole = 0;
  double force_n = 0;    ///< of the weight
  bool is_down = false;  ///< after a heavier one
  double lasted_s = 0;
  double found_n = 0, sigma_n = 0, noise_n = 0;  ///< mean force, its stated deviation, and the readings' own
  double drift_n = 0;                            ///< from the first readings to the last
  Vec3f found_mm = Vec3f::Zero(), truth_mm = Vec3f::Zero();
  double radius_mm = 0;
};

/// One part of an uncertainty, as a standard deviation.
struct BudgetLine {
  std::string source, how;
  double force_n = 0, touch_mm = 0;
};

struct Check {
  std::string name, clause, unit;
  std::optional<double> value, limit;  ///< no value: the recordings do not tell it
  bool at_least = false;
  bool passes() const { return !limit || (value && (at_least ? *value >= *limit : *value <= *limit)); }
};

struct Verification {
  std::vector<Plateau> plateaus;
  std::vector<Check> checks;
  std::vector<BudgetLine> budget;
  double force_expanded_n = 0, touch_expanded_mm = 0;  ///< k = 2
  bool passed = false;
};

/// `readings`: of each series in its order, by a device with its fit and mount. Throws InputError naming the recording
/// whose steps are not those of the plan.
Verification verify(const VerificationPlan& plan, const std::vector<JigHole>& holes,
                    const std::vector<std::vector<TouchReading>>& readings);

nlohmann::json verification_json(const VerificationPlan& plan, const Verification& verification, std::uint32_t date);
/// The certificate: one page that needs no other file.
std::string certificate_html(const VerificationPlan& plan, const Verification& verification, std::uint32_t date,
                             const std::string& pack, const std::string& commands);

}  // namespace finsight::host
