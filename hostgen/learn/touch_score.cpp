#include "hostgen/learn/touch_score.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>

#include "firmware/touch/features.h"
#include "firmware/touch/touch_stage.h"
#include "hostgen/util/statistics.h"

namespace finsight::host {

namespace {

constexpr double kEdges_mm[] = {0, 1, 2, 4, 7, 12, 1000};  // of plate motion

double radii(const TouchTrial& trial) {
  return static_cast<double>(trial.error_mm.norm()) / static_cast<double>(trial.radius_68_mm);
}

PlatePoses poses_of(const PoseVector& numbers, const Measuring& how) {
  PlatePoses poses = seen_poses({numbers.data(), kPoseDims});
  poses.seen = how.seen;
  poses.noise.fill(how.noise);
  return poses;
}

}  // namespace

std::vector<TouchTrial> run_trials(TouchNetwork& trained, const std::vector<FemState>& states,
                                   const std::array<PoseNoise, kPlates>& noise, const PlatePrior& prior,
                                   const Measuring& how) {
  TouchModel model = trained.model.view();
  model.threshold_mm = 0;  // trials below the threshold and over range are wanted, too
  model.range_mm = std::numeric_limits<float>::infinity();
  model.explained_above = model.explained_above_unknown_g = -std::numeric_limits<float>::infinity();
  model.stiffness_tolerance = model.touch_tolerance_mm = model.noise_per_mm =
      0;                                                            // the states are of one finger, as the spec has it
  TouchStage stage(model, std::numeric_limits<float>::infinity());  // every number is wanted, told or not
  const GravityCorrection gravity(model, std::nullopt);
  const float unknown_g = how.gravity_is_known ? 0 : GravityCorrection::kUnknown_g;
  Random random(how.seed);
  std::vector<TouchTrial> trials;
  for (const FemState& state : states) {
    for (int repeat = 0; repeat < how.repeats; ++repeat) {
      PoseVector numbers = touch_sample(state).numbers;
      if (!how.gravity_is_known) turn(gravity, 1, random, numbers);
      add_noise(noise, random, numbers, {how.noise, how.noise, how.noise});
      complete_from_prior(prior, how.seen, numbers);
      const PlatePoses poses = poses_of(numbers, how);
      const Touch touch = stage.locate(poses, numbers, {.unknown_g = unknown_g});
      const Vec3f float_point_mm = evaluate(trained, numbers, network_noise(poses), unknown_g).head<3>();
      trials.push_back({state.path, state.point_mm, touch.point_mm - state.point_mm, touch.plate_motion_mm,
                        touch.radius_68_mm, state.force_vector_n[0], (touch.point_mm - float_point_mm).norm(),
                        (float_point_mm - state.point_mm).norm()});
      const TouchSample truth = touch_sample(state);
      trials.back().wrench_error << touch.force_vector_n - truth.force_vector_n, touch.moment_nm - truth.moment_nm;
      trials.back().explained = touch.explained;
      trials.back().scene = state.scene;
      trials.back().gravity_is_known = how.gravity_is_known;
      trials.back().radius_features = radius_features(touch, touch.explained, touch.radius_68_mm, unknown_g);
      trials.back().wrench_sigma << touch.force_vector_sigma_n, touch.moment_sigma_nm;
    }
  }
  return trials;
}

namespace {

/// Trials of one band of plate motion, and the calibration of their radii.
struct Knot {
  std::vector<TouchTrial> trials;
  float motion_mm = 0, log_factor = 0, exponent = 1;
};

/// The exponent at which the radius that holds 68 % of the errors holds about 95 % when doubled: below 1 where the
/// network's radii vary more than its errors. Of equally good exponents the one nearest to 1, which keeps most of what
/// the network says.
void fit_exponent(Knot& knot) {
  double best = std::numeric_limits<double>::infinity();
  for (int tenths = 3; tenths <= 15; ++tenths) {
    const double exponent = 0.1 * tenths;
    std::vector<double> ratios;
    for (const TouchTrial& t : knot.trials) {
      ratios.push_back(static_cast<double>(t.error_mm.norm()) /
                       std::pow(static_cast<double>(t.radius_68_mm), exponent));
    }
    const double factor = quantile(ratios, 0.68);
    const auto inside = std::ranges::count_if(ratios, [&](double ratio) { return ratio <= 2 * factor; });
    const double share = static_cast<double>(inside) / static_cast<double>(ratios.size());
    const double cost = std::abs(share - 0.95) + 0.02 * std::abs(exponent - 1);
    if (cost >= best) continue;
    best = cost;
    knot.log_factor = static_cast<float>(std::log(factor));
    knot.exponent = static_cast<float>(exponent);
  }
}

std::vector<float> curve_of(const std::vector<Knot>& knots) {
  std::vector<float> curve;
  for (const Knot& knot : knots) curve.insert(curve.end(), {knot.motion_mm, knot.log_factor, knot.exponent});
  return curve;
}

/// Knots in the middle of the bands; bands with few trials take their neighbours' curve.
std::vector<float> radius_curve(const std::vector<TouchTrial>& trials, double threshold_mm) {
  constexpr std::size_t kMinTrials = 50;
  constexpr int kSweeps = 20;  // neighbouring knots share the curve between them
  std::vector<Knot> knots;
  for (std::size_t band = 0; band + 1 < std::size(kEdges_mm); ++band) {
    Knot knot;
    std::vector<double> motions_mm;
    for (const TouchTrial& trial : trials) {
      const auto motion_mm = static_cast<double>(trial.plate_motion_mm);
      if (motion_mm < std::max(kEdges_mm[band], threshold_mm) || motion_mm >= kEdges_mm[band + 1]) continue;
      knot.trials.push_back(trial);
      motions_mm.push_back(motion_mm);
    }
    if (knot.trials.size() < kMinTrials) continue;
    knot.motion_mm = static_cast<float>(quantile(std::move(motions_mm), 0.5));
    fit_exponent(knot);
    knots.push_back(std::move(knot));
  }
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    for (Knot& knot : knots) {
      const std::vector<float> curve = curve_of(knots);
      std::vector<double> ratios;
      for (const TouchTrial& t : knot.trials) {
        ratios.push_back(
            static_cast<double>(t.error_mm.norm() / calibrated_radius_mm(curve, t.plate_motion_mm, t.radius_68_mm)));
      }
      knot.log_factor += static_cast<float>(std::log(quantile(std::move(ratios), 0.68)));
    }
  }
  return curve_of(knots);
}

/// The log-odds that one trial in a thousand is below. A thousandth of a few hundred states, each measured several
/// times, would be the worst of them alone; so the exponential tail through the lowest hundredth and twentieth is
/// followed that far.
double false_alarm_limit(std::vector<double> log_odds) {
  constexpr double kFalseAlarms = 0.001, kFew = 0.01, kMore = 0.05;
  const double few = quantile(log_odds, kFew), more = quantile(std::move(log_odds), kMore);
  return few - (more - few) * std::log(kFew / kFalseAlarms) / std::log(kMore / kFew);
}

}  // namespace

float explained_limit(const std::vector<TouchTrial>& trials, double threshold_mm) {
  std::vector<double> explained;
  for (const TouchTrial& trial : trials) {
    if (static_cast<double>(trial.plate_motion_mm) >= threshold_mm) explained.push_back(trial.explained);
  }
  return explained.empty() ? -1e6F : static_cast<float>(false_alarm_limit(std::move(explained)));
}

Calibration calibrate(const std::vector<TouchTrial>& trials, double threshold_mm) {
  Calibration calibration;
  for (int i = 0; i < 6; ++i) {
    std::vector<double> ratios;
    for (const TouchTrial& trial : trials) {
      if (static_cast<double>(trial.plate_motion_mm) < threshold_mm) continue;
      ratios.push_back(static_cast<double>(std::abs(trial.wrench_error[i]) / trial.wrench_sigma[i]));
    }
    calibration.wrench[static_cast<std::size_t>(i)] = quantile(std::move(ratios), 0.6827, 1.0);
  }
  calibration.explained_above = explained_limit(trials, threshold_mm);
  if (auto curve = radius_curve(trials, threshold_mm); !curve.empty()) calibration.radius_curve = std::move(curve);
  return calibration;
}

// The network answers the logarithms of the standard deviations, so a factor is an addition to its mean.
void apply(const Calibration& calibration, TouchModelData& model) {
  model.radius_curve = calibration.radius_curve;
  model.explained_above = calibration.explained_above;
  for (std::size_t i = 0; i < calibration.wrench.size(); ++i) {
    model.output_mean[TouchModel::kMeans + 3 + i] += static_cast<float>(std::log(calibration.wrench[i]));
  }
}

TouchScore score(const std::vector<TouchTrial>& trials, double threshold_mm) {
  TouchScore score;
  Eigen::Array3d error_sq = Eigen::Array3d::Zero(), truth = error_sq, truth_sq = error_sq;
  Eigen::Array<double, 6, 1> wrench_sq = Eigen::Array<double, 6, 1>::Zero(), wrench_inside = wrench_sq;
  double inside = 0, inside_twice = 0;
  for (const TouchTrial& trial : trials) {
    if (trial.plate_motion_mm < threshold_mm) continue;
    ++score.touches;
    const double error_mm = static_cast<double>(trial.error_mm.norm());
    wrench_sq += trial.wrench_error.cast<double>().square();
    wrench_inside += (trial.wrench_error.abs() <= trial.wrench_sigma).cast<double>();
    error_sq += trial.error_mm.array().cast<double>().square();
    truth += trial.truth_mm.array().cast<double>();
    truth_sq += trial.truth_mm.array().cast<double>().square();
    score.mean_mm += error_mm;
    inside += radii(trial) <= 1.0;
    inside_twice += radii(trial) <= 2.0;
  }
  const double count = std::max<double>(1.0, static_cast<double>(score.touches));
  const Eigen::Array3d variance = truth_sq / count - (truth / count).square();
  for (int i = 0; i < 3; ++i) {
    score.rmse_mm[static_cast<std::size_t>(i)] = std::sqrt(error_sq[i] / count);
    score.r2[static_cast<std::size_t>(i)] = variance[i] > 0 ? 1.0 - error_sq[i] / count / variance[i] : 0.0;
  }
  for (int i = 0; i < 6; ++i) {
    score.wrench_rmse[static_cast<std::size_t>(i)] = std::sqrt(wrench_sq[i] / count);
    score.wrench_coverage_68[static_cast<std::size_t>(i)] = wrench_inside[i] / count;
  }
  score.mean_mm /= count;
  score.coverage_68 = inside / count;
  score.coverage_95 = inside_twice / count;
  return score;
}

namespace {

/// For each trial, which half of the paths it belongs to.
std::vector<std::size_t> halves_of_paths(const std::vector<TouchTrial>& trials) {
  std::vector<std::int32_t> paths;
  for (const TouchTrial& trial : trials) paths.push_back(trial.path);
  std::sort(paths.begin(), paths.end());
  paths.erase(std::unique(paths.begin(), paths.end()), paths.end());
  std::vector<std::size_t> halves;
  for (const TouchTrial& trial : trials) {
    const auto place = std::lower_bound(paths.begin(), paths.end(), trial.path) - paths.begin();
    halves.push_back(static_cast<std::size_t>(place % 2));
  }
  return halves;
}

std::array<std::vector<TouchTrial>, 2> by_half(const std::vector<TouchTrial>& trials,
                                               const std::vector<std::size_t>& half) {
  std::array<std::vector<TouchTrial>, 2> parts;
  for (std::size_t i = 0; i < trials.size(); ++i) parts[half[i]].push_back(trials[i]);
  return parts;
}

}  // namespace

std::vector<TouchTrial> cross_calibrated(const std::vector<TouchTrial>& trials, double threshold_mm) {
  const std::array<std::vector<TouchTrial>, 2> halves = by_half(trials, halves_of_paths(trials));
  std::vector<TouchTrial> calibrated;
  for (std::size_t half = 0; half < 2; ++half) {
    const Calibration calibration = calibrate(halves[1 - half], threshold_mm);
    for (TouchTrial trial : halves[half]) {
      trial.radius_68_mm = calibrated_radius_mm(calibration.radius_curve, trial.plate_motion_mm, trial.radius_68_mm);
      for (int i = 0; i < 6; ++i) {
        trial.wrench_sigma[i] *= static_cast<float>(calibration.wrench[static_cast<std::size_t>(i)]);
      }
      calibrated.push_back(trial);
    }
  }
  return calibrated;
}

float radius_factor(const std::vector<TouchTrial>& trials, double threshold_mm) {
  std::vector<double> ratios;
  for (const TouchTrial& trial : trials) {
    if (static_cast<double>(trial.plate_motion_mm) >= threshold_mm) ratios.push_back(radii(trial));
  }
  return static_cast<float>(quantile(std::move(ratios), 0.68, 1.0));
}

void scale_cross_fitted(std::vector<TouchTrial>& trials, double threshold_mm) {
  const std::vector<std::size_t> half = halves_of_paths(trials);
  const std::array<std::vector<TouchTrial>, 2> parts = by_half(trials, half);
  const std::array factors = {radius_factor(parts[1], threshold_mm), radius_factor(parts[0], threshold_mm)};
  for (std::size_t i = 0; i < trials.size(); ++i) trials[i].radius_68_mm *= factors[half[i]];
}

std::vector<TouchBand> error_bands(const std::vector<TouchTrial>& trials) {
  std::vector<TouchBand> bands;
  for (std::size_t b = 0; b + 1 < std::size(kEdges_mm); ++b) {
    TouchBand band{.from_mm = kEdges_mm[b], .to_mm = kEdges_mm[b + 1]};
    std::vector<double> errors;
    for (const TouchTrial& trial : trials) {
      const double motion_mm = static_cast<double>(trial.plate_motion_mm);
      if (motion_mm < band.from_mm || motion_mm >= band.to_mm) continue;
      errors.push_back(static_cast<double>(trial.error_mm.norm()));
      band.mean_mm += errors.back();
      band.coverage_68 += radii(trial) <= 1.0;
      band.coverage_95 += radii(trial) <= 2.0;
    }
    if (errors.empty()) continue;
    band.touches = errors.size();
    for (double* share : {&band.mean_mm, &band.coverage_68, &band.coverage_95})
      *share /= static_cast<double>(errors.size());
    band.error_95_mm = quantile(std::move(errors), 0.95);
    bands.push_back(band);
  }
  return bands;
}

std::vector<ForceBand> force_bands(const std::vector<TouchTrial>& trials, double threshold_mm) {
  std::vector<ForceBand> bands;
  for (int newton = 0; newton < 100; ++newton) {
    ForceBand band{.from_n = newton + 0.0, .to_n = newton + 1.0};
    double square = 0, inside = 0;
    for (const TouchTrial& trial : trials) {
      const bool here = trial.force_n >= static_cast<float>(newton) && trial.force_n < static_cast<float>(newton + 1);
      if (!here || trial.plate_motion_mm < threshold_mm) continue;
      const double error = static_cast<double>(trial.wrench_error[0]);
      ++band.touches;
      square += error * error;
      band.bias_n += error;
      inside += std::abs(trial.wrench_error[0]) <= trial.wrench_sigma[0];
    }
    if (band.touches == 0) continue;
    const double count = static_cast<double>(band.touches);
    band.rmse_n = std::sqrt(square / count);
    band.bias_n /= count;
    band.coverage_68 = inside / count;
    bands.push_back(band);
  }
  return bands;
}

std::vector<double> coverage_curve(const std::vector<TouchTrial>& trials, double threshold_mm) {
  constexpr int kSteps = 30;
  std::vector<double> curve(kSteps, 0.0);
  double count = 0;
  for (const TouchTrial& trial : trials) {
    if (trial.plate_motion_mm < threshold_mm) continue;
    ++count;
    for (int k = 0; k < kSteps; ++k) curve[static_cast<std::size_t>(k)] += radii(trial) <= 0.1 * (k + 1);
  }
  for (double& share : curve) share /= std::max(1.0, count);
  return curve;
}

Quantisation quantisation_cost(const std::vector<TouchTrial>& trials, double threshold_mm) {
  Quantisation cost;
  double count = 0;
  for (const TouchTrial& trial : trials) {
    if (trial.plate_motion_mm < threshold_mm) continue;
    ++count;
    const double moved_mm = static_cast<double>(trial.quantisation_mm);
    cost.mean_mm += moved_mm;
    cost.worst_mm = std::max(cost.worst_mm, moved_mm);
    cost.float_error_mm += static_cast<double>(trial.float_error_mm);
    cost.int8_error_mm += static_cast<double>(trial.error_mm.norm());
  }
  for (double* mean : {&cost.mean_mm, &cost.float_error_mm, &cost.int8_error_mm}) *mean /= std::max(1.0, count);
  return cost;
}

std::string error_table(const std::vector<TouchBand>& bands) {
  std::string table;
  for (const TouchBand& band : bands) {
    char line[160];
    std::snprintf(
        line, sizeof line,
        "  plate motion from %4.0f mm: %6zu touches, mean error %5.2f mm, 95 %% %6.2f mm, inside radius %4.1f %%, "
        "inside twice %4.1f %%\n",
        band.from_mm, band.touches, band.mean_mm, band.error_95_mm, 100 * band.coverage_68, 100 * band.coverage_95);
    table += line;
  }
  return table;
}

std::string force_table(const std::vector<ForceBand>& bands) {
  std::string table;
  for (const ForceBand& band : bands) {
    char line[160];
    std::snprintf(line, sizeof line,
                  "  force from %2.0f N: %6zu touches, RMSE %.2f N, mean error %+.2f N, inside deviation %4.1f %%\n",
                  band.from_n, band.touches, band.rmse_n, band.bias_n, 100 * band.coverage_68);
    table += line;
  }
  return table;
}

}  // namespace finsight::host
