// Is a finger as right as it says? Known weights, up and down, at the holes of its jig, in the manner of a load cell's
// calibration (ISO 376:2011, clause 7.5) and of touch tests of robot hands (NIST SP 1227), as far as they fit a finger
// that also says where it is touched.
#pragma once

#include <functional>
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
  std::optional<double> detection_n;  ///< from which force on every weight is detected; else all of them must be
  std::optional<double> coverage_68;  ///< the least that passes, of forces and of touches
  bool operator==(const VerificationLimits&) const = default;
};

struct VerificationPlan {
  std::string finger;  ///< serial number or name, for the certificate
  std::vector<PlannedSeries> series;
  VerificationLimits limits;
};

/// Strict: throws InputError like TomlTable, and for a plan without any limit. Holes 1 to `holes`.
VerificationPlan read_plan(const std::filesystem::path& file, int holes);

/// A weight at rest that the finger shows.
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
  PlatePoses poses{};  ///< of one reading in its middle
};

/// A weight that was too light for the finger to show it.
struct MissedWeight {
  std::string session;
  int hole = 0;
  double force_n = 0;
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
  std::vector<MissedWeight> missed;
  std::vector<Check> checks;
  std::vector<BudgetLine> budget;
  double force_expanded_n = 0, touch_expanded_mm = 0;  ///< k = 2
  bool passed = false;
};

/// Of all that a device measures of a touch.
struct ForceAndPlace {
  double force_n = 0;
  Vec3f point_mm = Vec3f::Zero();
};
/// What the device that is verified says of poses of its plates, for the parts that lens and mount have in its errors.
using PoseReader = std::function<ForceAndPlace(const PlatePoses&)>;

/// How `verify` is to judge.
struct VerificationKind {
  bool is_quick = false;       ///< the daily check: limits that its recordings do not tell are not judged
  bool has_turn_told = false;  ///< how the camera is turned was measured, by `hostgen mount` or a fit
  PoseReader read_poses = {};  ///< nothing: lens and mount are not told apart from the model
  Eigen::Matrix3d R_finger_camera = Eigen::Matrix3d::Identity();
};

/// `readings`: of each series in its order, by a device with its fit and mount. Throws InputError naming the recording
/// whose steps are not those of the plan, but for weights too light to be seen, and if no limit can be judged.
Verification verify(const VerificationPlan& plan, const std::vector<JigHole>& holes,
                    const std::vector<std::vector<TouchReading>>& readings, const VerificationKind& kind = {});

/// What a certificate says of the device: the files that it works with, in words.
struct CertificateHead {
  std::uint32_t date = 0;
  std::string pack = {}, fit = {}, mount = {};
  bool is_quick = false;
};

/// With the settings for the device's registers; a quick check that passed has none.
nlohmann::json verification_json(const VerificationPlan& plan, const Verification& verification,
                                 const CertificateHead& head);
/// The certificate: one page that needs no other file.
std::string certificate_html(const VerificationPlan& plan, const Verification& verification,
                             const CertificateHead& head, const std::string& commands);

}  // namespace finsight::host
