#include "hostgen/fit/weight_fit.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "firmware/input_error.h"
#include "firmware/touch/touch_stage.h"
#include "hostgen/finger/spec.h"
#include "hostgen/fit/creep_fit.h"
#include "hostgen/util/gravity.h"
#include "hostgen/util/statistics.h"

namespace finsight::host {

namespace {

constexpr int kTerms = FitValues::kTerms;
using Terms = Eigen::Matrix<double, kTerms, 1>;

// What fingers of the workshop have in common once their motions are fitted: deviations of the terms, and what the
// terms do not describe. Measured with `hostgen report ... fit` on fingers that its figures do not count.
const Terms kAcrossPrior_mm(0.1, 0.15, 0.1, 0.1);
const Terms kAlongPrior_mm(0.4, 0.4, 0.3, 0.4);
constexpr double kAcrossRest_mm = 0.1, kAlongRest_mm = 0.1;
constexpr double kAwayFromHoles_mm = 0.2;  // what a radius needs besides, to hold 68 % of the touches between the holes
// Of the force, relative, beside the pack's tolerance in the middle of the face; and what remains.
const Eigen::Vector3d kForceSlopePrior(0.02, 0.03, 0.03);
constexpr double kForceRest = 0.02;
// MotionFit::unlike: up to which those numbers hold, beyond which they grow; and at which plates move as on a finger
// that is not fitted.
constexpr double kWellFitted = 0.007, kNotFitted = 0.034;
constexpr double kUnknownCreep = 0.06;      // relative deviation of forces of unknown age
constexpr double kHysteresis = 0.02;        // relative deviation of forces that grew or fell before
constexpr float kUsualHysteresis = 0.065F;  // of polyurethane: widest gap, of the full force

constexpr double kSettling_s = 0.5;  // after a weight was hung up, and before it is taken off
constexpr double kShortestHold_s = 2, kShortestBreak_s = 0.9;
constexpr double kCreepHold_s = 20;  // tells creep
constexpr double kRested_mm = 0.06;  // from where it was before it was touched; the means of two zeros differ by 0.02
// Elsewhere on the face a touch may be that much less like the pack's than at any hole (log-odds).
constexpr float kLessThanAtHoles = 2;
constexpr double kWrongForce = 0.35, kWrongPlace_mm = 9;
const double kWrongStiffness = std::log(3.0);  // no batch of a material differs that much from its spec
constexpr double kUsualRest = 3;               // what remains of the forces, over kForceRest, is stated as it is beyond

/// The readings of a hold while its weight hung still.
struct Series {
  std::vector<TouchReading> readings;
  ForceSeries forces;
};

/// The longest touch: from its first reading to behind its last. Single frames of a touch may be unexplained, but no
/// weight comes off and back within kShortestBreak_s.
std::pair<std::size_t, std::size_t> longest_touch(const std::vector<TouchReading>& readings) {
  std::pair<std::size_t, std::size_t> best{0, 0};
  std::size_t first = 0, end = 0;
  for (std::size_t i = 0; i < readings.size(); ++i) {
    if (!readings[i].is_valid) continue;
    if (end == 0 || readings[i].time_s - readings[end - 1].time_s > kShortestBreak_s) first = i;
    end = i + 1;
    if (end - first > best.second - best.first) best = {first, end};
  }
  return best;
}

const JigHole& hole_of(const FitBasis& basis, const WeightRecord& record) {
  for (const JigHole& hole : basis.holes) {
    if (hole.number == record.hole) return hole;
  }
  throw InputError(record.name, "hole", std::to_string(record.hole),
                   "1 to " + std::to_string(basis.holes.size()) + ", as printed on the jig");
}

void summarise(Series& series, WeightHold& hold) {
  series.forces.force_n.clear();
  hold.point_mm.setZero();
  hold.explained = std::numeric_limits<float>::infinity();
  hold.plate_motion_mm = 0;
  for (const TouchReading& reading : series.readings) {
    series.forces.force_n.push_back(reading.force_n);
    hold.point_mm += reading.point_mm / static_cast<float>(series.readings.size());
    hold.explained = std::min(hold.explained, reading.explained);
    hold.plate_motion_mm = std::max(hold.plate_motion_mm, reading.plate_motion_mm);
  }
}

WeightHold hold_of(const FitBasis& basis, const WeightRecord& record, Series& series) {
  const auto [first, end] = longest_touch(record.readings);
  WeightHold hold{.name = record.name, .hole = record.hole, .force_n = record.force_n};
  hold.truth_mm = hole_of(basis, record).contact_mm.cast<float>();
  if (first < end) {
    hold.began_s = record.readings[first].time_s;
    hold.lasted_s = record.readings[end - 1].time_s - hold.began_s;
  }
  for (std::size_t i = first; i < end; ++i) {
    const TouchReading& reading = record.readings[i];
    const double after_s = reading.time_s - hold.began_s;
    if (!reading.is_valid || after_s < kSettling_s || after_s > hold.lasted_s - kSettling_s) continue;
    series.readings.push_back(reading);
    series.forces.after_s.push_back(after_s);
  }
  if (hold.lasted_s < kShortestHold_s) {
    throw InputError(record.name, "touched for", std::to_string(hold.lasted_s) + " s without a break",
                     "two seconds or more; is the weight too light for this hole?");
  }
  summarise(series, hold);
  return hold;
}

std::string grams(double force_n) { return std::to_string(std::lround(force_n / weight_n(1))); }

double median_of(std::vector<double> numbers) { return quantile(std::move(numbers), 0.5); }

/// What the other recordings, or the spec, say that hung there.
[[noreturn]] void refuse_weight(const WeightHold& hold, const std::string& expected) {
  throw InputError(hold.name, "mass_g", grams(hold.force_n), expected);
}

void check_masses(const std::vector<WeightHold>& holds, const std::vector<double>& scale, double usual_scale) {
  const auto fitting = [&](std::size_t i, double log_scale) {
    return grams(holds[i].force_n * std::exp(log_scale - scale[i]));
  };
  for (std::size_t i = 0; i < holds.size() && holds.size() > 2; ++i) {
    if (std::abs(scale[i] - usual_scale) < kWrongForce) continue;
    refuse_weight(holds[i], "about " + fitting(i, usual_scale) + ", as the other recordings have it");
  }
  if (holds.size() == 2 && std::abs(scale[0] - scale[1]) >= kWrongForce) {
    refuse_weight(holds[0], "about " + fitting(0, scale[1]) + " if " + holds[1].name + " is right, or there " +
                                fitting(1, scale[0]) + " instead of " + grams(holds[1].force_n));
  }
  if (std::abs(usual_scale) < kWrongStiffness) return;
  refuse_weight(holds[0], fitting(0, -kWrongStiffness) + " to " + fitting(0, kWrongStiffness) +
                              " of a finger that is at most three times as stiff or soft as its spec's");
}

// A wrong hole shows by the touch, a wrong weight by a force that no other agrees with.
void check_holds(const FitBasis& basis, const std::vector<WeightHold>& holds) {
  std::vector<double> along, scale;
  for (const WeightHold& hold : holds) {
    along.push_back(static_cast<double>((hold.point_mm - hold.truth_mm).dot(basis.face_axes.col(2))));
    scale.push_back(std::log(hold.force_n / hold.pack_force_n));
  }
  const double usual_mm = median_of(along), usual_scale = median_of(scale);
  for (const WeightHold& hold : holds) {
    const Vec3f seen_mm = hold.point_mm - static_cast<float>(usual_mm) * basis.face_axes.col(2);
    const auto away_mm = [&](const JigHole& hole) { return (hole.contact_mm.cast<float>() - seen_mm).norm(); };
    const auto nearest = std::ranges::min_element(basis.holes, {}, away_mm);
    if (nearest->number != hold.hole && static_cast<double>((seen_mm - hold.truth_mm).norm()) > kWrongPlace_mm) {
      throw InputError(hold.name, "hole", std::to_string(hold.hole) + " in the list of weights",
                       std::to_string(nearest->number) + ", which is where the finger was touched");
    }
  }
  check_masses(holds, scale, usual_scale);
}

void take_out_creep(const std::vector<Series>& series, const std::optional<Creep>& creep, WeightFit& fit) {
  for (std::size_t i = 0; i < series.size(); ++i)
    fit.holds[i].pack_force_n = mean_without_creep(series[i].forces, creep);
}

/// Sets the holds and their readings, and checks them.
std::optional<Creep> read_holds(const FitBasis& basis, const std::vector<WeightRecord>& records,
                                std::vector<Series>& series, WeightFit& fit) {
  std::vector<ForceSeries> long_holds;
  for (std::size_t i = 0; i < records.size(); ++i) {
    fit.holds.push_back(hold_of(basis, records[i], series[i]));
    if (fit.holds[i].lasted_s >= kCreepHold_s) long_holds.push_back(series[i].forces);
  }
  const std::optional<Creep> creep = fit_creep(long_holds);
  take_out_creep(series, creep, fit);
  check_holds(basis, fit.holds);
  return creep;
}

// The jig numbers its holes from 1.
MotionFit motions_of(const FitBasis& basis, const std::vector<Series>& series, const std::vector<WeightHold>& holds) {
  std::vector<SeenMotion> seen;
  for (std::size_t i = 0; i < holds.size(); ++i) {
    SeenMotion mean{static_cast<std::size_t>(holds[i].hole - 1), PoseVectorOf<double>::Zero()};
    for (const TouchReading& reading : series[i].readings) {
      mean.motion += pose_vector(reading.poses).cast<double>() / static_cast<double>(series[i].readings.size());
    }
    seen.push_back(mean);
  }
  return fit_motions(basis.motions, seen);
}

/// What a device with the fit's motions says of the weights, and what the pack says wrong about them.
void read_again(const FitBasis& basis, std::vector<Series>& series, WeightFit& fit) {
  const FingerFit device(fit.values);
  TouchStage stage(*basis.model);
  stage.use_tolerances(basis.force_tolerance, basis.touch_tolerance_mm, fit.values.noise_per_mm);
  stage.explain_less_likely(std::numeric_limits<float>::infinity());
  for (std::size_t i = 0; i < series.size(); ++i) {
    WeightHold& hold = fit.holds[i];
    for (TouchReading& reading : series[i].readings) {
      device.change_motions(reading.poses);
      const Touch touch = stage.locate(reading.poses);
      if (touch.quality == Quality::kInvalid) continue;
      reading.point_mm = touch.point_mm;
      reading.force_n = static_cast<double>(touch.force_n);
      reading.explained = touch.explained;
      reading.plate_motion_mm = touch.plate_motion_mm;
    }
    summarise(series[i], hold);
    const PressedPlace& place = basis.motions.holes[static_cast<std::size_t>(hold.hole - 1)];
    hold.pack_error = pack_error(place, fit.motions.force_n[i], hold.truth_mm, stage);
  }
}

void fit_motions(const FitBasis& basis, std::vector<Series>& series, WeightFit& fit) {
  if (!basis.model) return;
  fit.motions = motions_of(basis, series, fit.holds);
  fit.values.motion_change = fit.motions.correction.cast<float>();
  fit.values.noise_per_mm *= static_cast<float>(std::min(1.0, fit.motions.unlike / kNotFitted));
  read_again(basis, series, fit);
}

/// Of a quantity over the face.
struct Polynomial {
  Terms mean = Terms::Zero();
  Eigen::Matrix<double, kTerms, kTerms> covariance;
};

/// `prior`, `rest`: standard deviations of the terms, and of what they do not describe.
Polynomial polynomial(const Terms& prior, double rest, const std::vector<Terms>& terms,
                      const std::vector<double>& seen) {
  Eigen::Matrix<double, kTerms, kTerms> information = prior.cwiseAbs2().cwiseInverse().asDiagonal();
  Terms right = Terms::Zero();
  for (std::size_t i = 0; i < terms.size(); ++i) {
    information += terms[i] * terms[i].transpose() / (rest * rest);
    right += seen[i] * terms[i] / (rest * rest);
  }
  Polynomial found;
  found.covariance = information.inverse();
  found.mean = found.covariance * right;
  return found;
}

double rms_of_rest(const Polynomial& found, const std::vector<Terms>& terms, const std::vector<double>& seen) {
  double sum = 0;
  for (std::size_t i = 0; i < terms.size(); ++i) {
    const double rest = seen[i] - found.mean.dot(terms[i]);
    sum += rest * rest;
  }
  return std::sqrt(sum / static_cast<double>(terms.size()));
}

Terms terms_at(const FitValues& values, const Vec3f& point_mm) {
  const auto terms = fit_terms(values, point_mm);
  return Eigen::Map<const Eigen::Matrix<float, kTerms, 1>>(terms.data()).cast<double>();
}

std::vector<Terms> terms_of(const WeightFit& fit) {
  std::vector<Terms> terms;
  for (const WeightHold& hold : fit.holds) terms.push_back(terms_at(fit.values, hold.point_mm));
  return terms;
}

/// Mean variance over the face.
double unknown_sq(const FitBasis& basis, const FitValues& values, const Polynomial& of) {
  double sum = 0;
  for (const JigHole& hole : basis.holes) {
    const Terms at = terms_at(values, hole.contact_mm.cast<float>());
    sum += at.dot(of.covariance * at) / static_cast<double>(basis.holes.size());
  }
  return sum;
}

/// How much less a fit may take for granted of a finger whose motions it did not explain.
double wider(const WeightFit& fit) { return std::max(1.0, fit.motions.unlike / kWellFitted); }

/// Of both offsets together, where the weights were.
void fit_offsets(const FitBasis& basis, WeightFit& fit) {
  const std::vector<Terms> terms = terms_of(fit);
  std::vector<double> across, along;
  for (const WeightHold& hold : fit.holds) {
    const Vec3f off_mm = hold.point_mm - hold.truth_mm - hold.pack_error.touch_mm;
    across.push_back(static_cast<double>(off_mm.dot(basis.face_axes.col(1))));
    along.push_back(static_cast<double>(off_mm.dot(basis.face_axes.col(2))));
  }
  const double across_rest_mm = wider(fit) * kAcrossRest_mm, along_rest_mm = wider(fit) * kAlongRest_mm;
  const double elsewhere_mm = wider(fit) * kAwayFromHoles_mm;
  const Polynomial x = polynomial(wider(fit) * kAcrossPrior_mm, across_rest_mm, terms, across),
                   y = polynomial(wider(fit) * kAlongPrior_mm, along_rest_mm, terms, along);
  Eigen::Map<Eigen::Matrix<float, kTerms, 1>>(fit.values.across_mm.data()) = x.mean.cast<float>();
  Eigen::Map<Eigen::Matrix<float, kTerms, 1>>(fit.values.along_mm.data()) = y.mean.cast<float>();
  fit.values.touch_radius_mm = static_cast<float>(
      std::sqrt(unknown_sq(basis, fit.values, x) + unknown_sq(basis, fit.values, y) + across_rest_mm * across_rest_mm +
                along_rest_mm * along_rest_mm + elsewhere_mm * elsewhere_mm));
}

/// Each weight finds what the ones before have left in the finger, unless that has rested since.
void take_out_hysteresis(const std::vector<WeightRecord>& records, WeightFit& fit) {
  Hysteresis material(fit.values);
  for (std::size_t i = 0; i < fit.holds.size(); ++i) {
    WeightHold& hold = fit.holds[i];
    if (records[i].left_mm.value_or(kRested_mm) < kRested_mm) material = Hysteresis(fit.values);
    const auto force_n = static_cast<float>(hold.force_n);
    hold.elastic_n = static_cast<double>(material.elastic_n(force_n));
    material.follow(force_n);
    material.follow(0);
  }
}

void fit_force(const FitBasis& basis, const std::optional<Creep>& creep, WeightFit& fit) {
  Terms prior;
  prior << static_cast<double>(basis.force_tolerance), wider(fit) * kForceSlopePrior;
  double rest = wider(fit) * kForceRest;
  std::vector<double> scale;
  for (const WeightHold& hold : fit.holds) {
    scale.push_back(std::log(hold.elastic_n / hold.pack_force_n) - hold.pack_error.log_force);
  }
  const std::vector<Terms> terms = terms_of(fit);
  Polynomial found = polynomial(prior, rest, terms, scale);
  const double remaining = rms_of_rest(found, terms, scale);
  if (remaining > kUsualRest * rest) {
    rest = remaining;
    found = polynomial(prior, rest, terms, scale);
  }
  fit.values.force_scale = static_cast<float>(std::exp(found.mean[0]));
  fit.values.force_scale_sigma = static_cast<float>(std::sqrt(found.covariance(0, 0)));
  Eigen::Map<Vec3f>(fit.values.force_slope.data()) = found.mean.tail<3>().cast<float>();
  const double of_creep = creep ? std::min(creep->sigma, kUnknownCreep) : kUnknownCreep;
  fit.values.force_sigma = static_cast<float>(
      std::sqrt(unknown_sq(basis, fit.values, found) + rest * rest + of_creep * of_creep + kHysteresis * kHysteresis));
}

void fit_explained(const FitBasis& basis, WeightFit& fit) {
  for (const WeightHold& hold : fit.holds) {
    fit.values.explained_lower =
        std::max(fit.values.explained_lower, basis.explained_above - (hold.explained - kLessThanAtHoles));
  }
}

void note_errors(const FitBasis& basis, WeightFit& fit) {
  for (WeightHold& hold : fit.holds) {
    Touch touch{.point_mm = hold.point_mm, .quality = Quality::kFresh};
    FingerFit(fit.values).apply(basis.face_axes, 1, touch);
    hold.touch_error_mm = touch.point_mm - hold.truth_mm;
    hold.force_error =
        static_cast<double>(force_scale_at(fit.values, hold.point_mm)) * hold.pack_force_n / hold.elastic_n - 1;
  }
}

void note_untold(const FitBasis& basis, const std::optional<Creep>& creep, WeightFit& fit) {
  if (!creep) {
    fit.untold.push_back("creep: no weight hung for " + std::to_string(static_cast<int>(kCreepHold_s)) +
                         " seconds or longer, so that forces that last are " +
                         std::to_string(static_cast<int>(100 * kUnknownCreep)) + " % less sure");
  }
  const auto spread = [&](int axis) {
    float lowest = std::numeric_limits<float>::infinity(), highest = -lowest;
    for (const WeightHold& hold : fit.holds) {
      lowest = std::min(lowest, hold.truth_mm[axis]);
      highest = std::max(highest, hold.truth_mm[axis]);
    }
    return highest - lowest;
  };
  if (spread(1) < basis.face_half_mm[1])
    fit.untold.emplace_back("touch offset along the finger: the weights hung at one height");
  if (spread(0) < basis.face_half_mm[0])
    fit.untold.emplace_back("touch offset across the finger: the weights hung in one column");
}

}  // namespace

FitBasis fit_basis(const FingerSpec& spec, const Model& model) {
  FitBasis basis;
  basis.holes = jig_holes(spec);
  basis.model = &model;
  basis.model_checksum = model.checksum;
  basis.face_axes = Eigen::Map<const Eigen::Matrix3f>(model.touch.face_axes.data());
  const double middle_mm = (spec.touch_y_mm[0] + spec.touch_y_mm[1]) / 2;
  basis.face_middle_mm = Vec3f(0, static_cast<float>(middle_mm), static_cast<float>(spec.front_z.at(middle_mm)));
  basis.face_half_mm = {static_cast<float>(spec.half_width.at(middle_mm)),
                        static_cast<float>((spec.touch_y_mm[1] - spec.touch_y_mm[0]) / 2)};
  basis.force_range_n = static_cast<float>(spec.force_n[1]);
  basis.force_tolerance = model.touch.stiffness_tolerance;
  basis.touch_tolerance_mm = model.touch.touch_tolerance_mm;
  basis.noise_per_mm = model.touch.noise_per_mm;
  basis.explained_above = model.touch.explained_above;
  return basis;
}

FitValues weighing(const TouchModel& touch) {
  return {.force_sigma = touch.stiffness_tolerance,
          .touch_radius_mm = touch.touch_tolerance_mm,
          .noise_per_mm = touch.noise_per_mm,
          .explained_lower = std::numeric_limits<float>::infinity()};
}

void check_weights(const FitBasis& basis, const std::vector<WeightRecord>& records) {
  std::vector<Series> series(records.size());
  WeightFit fit;
  read_holds(basis, records, series, fit);
}

WeightFit fit_weights(const FitBasis& basis, const std::vector<WeightRecord>& records, std::uint16_t today) {
  WeightFit fit;
  fit.values.model_checksum = basis.model_checksum;
  fit.values.fitted_on = today;
  fit.values.hysteresis = kUsualHysteresis;
  fit.values.force_range_n = basis.force_range_n;
  fit.values.noise_per_mm = basis.noise_per_mm;
  fit.values.face_middle_mm = basis.face_middle_mm;
  fit.values.face_half_mm = basis.face_half_mm;
  std::vector<Series> series(records.size());
  const std::optional<Creep> creep = read_holds(basis, records, series, fit);
  if (creep) {
    fit.values.creep_share = static_cast<float>(creep->share);
    fit.values.creep_s = static_cast<float>(creep->after_s);
    fit.creep_share_sigma = creep->sigma;
  }
  fit_motions(basis, series, fit);
  take_out_creep(series, creep, fit);
  take_out_hysteresis(records, fit);
  fit_offsets(basis, fit);
  fit_force(basis, creep, fit);
  fit_explained(basis, fit);
  note_errors(basis, fit);
  note_untold(basis, creep, fit);
  return fit;
}

}  // namespace finsight::host
