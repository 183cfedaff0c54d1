#include "hostgen/learn/touch_training.h"

#include <algorithm>
#include <cstdio>
#include <iterator>
#include <optional>

#include "hostgen/finger/plate_geometry.h"
#include "hostgen/learn/radius_training.h"
#include "hostgen/learn/split.h"
#include "hostgen/learn/touch_score.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

constexpr std::size_t kMeasuredPerTouch = 25;  // of the touches that are drawn between the states, about
constexpr std::int32_t kFold = 5;              // one point in this many is held out
constexpr int kNoisyRepeats = 20, kTurnedRepeats = 5;
constexpr int kKeptRepeats = 6;  // of what is kept from learning, which has many places

struct StateSplit {
  std::vector<FemState> train, test;              ///< of the scene
  std::vector<FemState> other_train, other_test;  ///< of others
};

/// Every fifth path is held out.
void split_paths(const std::vector<FemState>& states, std::vector<FemState>& train, std::vector<FemState>& test) {
  std::vector<std::int32_t> paths;
  for (const FemState& state : states) paths.push_back(state.path);
  paths.erase(std::unique(paths.begin(), paths.end()), paths.end());
  for (const FemState& state : states) {
    const auto place = std::lower_bound(paths.begin(), paths.end(), state.path) - paths.begin();
    (place % kFold == kFold / 2 ? test : train).push_back(state);
  }
}

StateSplit without_paths(const std::vector<FemState>& states, const std::vector<FemState>& others) {
  StateSplit split;
  split_paths(states, split.train, split.test);
  split_paths(others, split.other_train, split.other_test);
  return split;
}

StateSplit without_states(const std::vector<FemState>& states, std::uint64_t seed) {
  const Split rows = random_split(states.size(), seed);
  StateSplit split;
  for (const std::size_t row : rows.train) split.train.push_back(states[row]);
  for (const std::size_t row : rows.test) split.test.push_back(states[row]);
  return split;
}

std::string line(const char* name, const TouchScore& score) {
  const auto& rmse = score.wrench_rmse;
  char text[400];
  std::snprintf(
      text, sizeof text,
      "%s: %zu touches, RMSE x %.2f y %.2f z %.2f mm, R2 %.4f %.4f %.4f, mean %.2f mm, force %.2f %.2f %.2f N, "
      "moment %.3f %.3f %.3f N m, inside radius %.1f %%, inside twice %.1f %%\n",
      name, score.touches, score.rmse_mm[0], score.rmse_mm[1], score.rmse_mm[2], score.r2[0], score.r2[1], score.r2[2],
      score.mean_mm, rmse[0], rmse[1], rmse[2], rmse[3], rmse[4], rmse[5], 100 * score.coverage_68,
      100 * score.coverage_95);
  return text;
}

std::vector<FemState> valid_states(const std::vector<FemState>& all) {
  std::vector<FemState> states;
  for (const FemState& state : all) {
    if (state.valid() && state.force_n > 0) states.push_back(state);
  }
  std::stable_sort(states.begin(), states.end(), [](const FemState& a, const FemState& b) { return a.path < b.path; });
  return states;
}

// A network with its test states; quantised, with its threshold, not yet calibrated.
struct Run {
  std::string tested;  // in words: what is held out
  StateSplit split;
  std::optional<TouchNetwork> trained;

  std::vector<TouchTrial> clean_trials(const PlatePrior& prior) {
    return run_trials(*trained, split.test, {}, prior, {.noise = 0});
  }
  std::vector<TouchTrial> noisy_trials(const FingerSpec& spec, const PlatePrior& prior, std::uint64_t seed,
                                       const std::array<bool, kPlates>& seen = {true, true, true},
                                       int repeats = kNoisyRepeats) {
    return run_trials(*trained, split.test, spec.noise, prior,
                      {.noise = 1, .seen = seen, .repeats = repeats, .seed = seed});
  }
  std::vector<TouchTrial> turned_trials(const FingerSpec& spec, const PlatePrior& prior, std::uint64_t seed) {
    return run_trials(*trained, split.test, spec.noise, prior,
                      {.noise = 1, .repeats = kTurnedRepeats, .seed = seed, .gravity_is_known = false});
  }
  std::vector<TouchTrial> other_trials(const FingerSpec& spec, const PlatePrior& prior, std::uint64_t seed) {
    return run_trials(*trained, split.other_test, spec.noise, prior,
                      {.noise = 1, .repeats = kNoisyRepeats, .seed = seed});
  }
};

// A network always answers. A little beyond the training states its answer still holds, far beyond it is a guess.
constexpr float kBeyondTraining = 1.15f;

float largest_plate_motion_mm(const std::vector<FemState>& states) {
  float largest = 0;
  for (const FemState& state : states) largest = std::max(largest, plate_motion_mm(state.plates));
  return largest;
}

/// Of the touched part of the face, on average: columns normal, across, along.
std::vector<float> mean_face_axes(const FingerSpec& spec) {
  constexpr int kSteps = 8;
  constexpr double kStep_mm = 2;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (int i = 1; i < kSteps; ++i) {
    const double y = spec.touch_y_mm[0] + (spec.touch_y_mm[1] - spec.touch_y_mm[0]) * i / kSteps;
    for (int j = 1; j < kSteps; ++j) {
      const double x = (spec.half_width.at(y) - spec.touch_edge_mm) * (2.0 * j / kSteps - 1);
      const Eigen::Vector3d across = front_point_mm(spec, x + kStep_mm, y) - front_point_mm(spec, x - kStep_mm, y);
      const Eigen::Vector3d up = front_point_mm(spec, x, y + kStep_mm) - front_point_mm(spec, x, y - kStep_mm);
      sum += across.cross(up).normalized();
    }
  }
  const Eigen::Matrix3f axes = face_axes(sum.normalized()).cast<float>();
  return {axes.data(), axes.data() + axes.size()};
}

void train(Run& run, const FingerSpec& spec, const PlatePrior& prior, const TouchTrainingPlan& plan,
           const TouchSource& source, std::uint64_t seed, Progress& progress) {
  Random random(seed);
  const std::size_t count =
      static_cast<std::size_t>(plan.steps) * static_cast<std::size_t>(plan.batch) / kMeasuredPerTouch;
  const std::vector<TouchSample> touches = source(run.split.train, run.split.other_train, count, random);
  const CornerMeasurement camera(spec, prior);
  const auto tick = [&] {
    if (interrupted()) throw Interrupted();
    progress.advance();
  };
  TouchTrainingPlan swinging = plan;
  for (std::size_t p = 0; p < kPlates; ++p) {
    swinging.plate_height_mm[p] = spec.plates[p].T_finger_marker.translation().y();
  }
  run.trained = train_touch_network(touches, spec.noise, prior, swinging, seed + 1, tick, &camera);
  quantise(*run.trained);
  run.trained->model.face_axes = mean_face_axes(spec);
  run.trained->model.threshold_mm = static_cast<float>(spec.threshold_mm);
  run.trained->model.stiffness_tolerance = static_cast<float>(spec.tolerance.force);
  run.trained->model.marker_tolerance_mm = static_cast<float>(spec.tolerance.marker_mm);
  run.trained->model.marker_tolerance_rad = static_cast<float>(spec.tolerance.marker_rad);
  run.trained->model.touch_tolerance_mm = static_cast<float>(spec.tolerance.touch_mm);
  run.trained->model.noise_per_mm = static_cast<float>(spec.tolerance.noise_per_mm);
  run.trained->model.range_mm = kBeyondTraining * largest_plate_motion_mm(run.split.train);
}

/// Calibrates the radius where plates are missing, and tells how it then does. `run` is calibrated for all plates.
std::string calibrate_missing_plates(Run& run, const FingerSpec& spec, const PlatePrior& prior, std::uint64_t seed) {
  std::string table;
  std::vector<float>& factors = run.trained->model.seen_factor;
  for (std::size_t pattern = 0; pattern + 1 < factors.size(); ++pattern) {
    std::array<bool, kPlates> seen;
    std::string names;
    for (std::size_t p = 0; p < kPlates; ++p) {
      seen[p] = ((pattern + 1) >> p) & 1;
      if (seen[p]) names += (names.empty() ? "" : " and ") + std::string(kPlateNames[p]);
    }
    std::vector<TouchTrial> trials = run.noisy_trials(spec, prior, seed, seen);
    factors[pattern] = radius_factor(trials, spec.threshold_mm);
    scale_cross_fitted(trials, spec.threshold_mm);
    table += line((run.tested + ", noisy, only " + names + " seen").c_str(), score(trials, spec.threshold_mm));
  }
  return table;
}

std::vector<Detection> detections(const std::vector<TouchTrial>& trials, float explained_above,
                                  const std::vector<Scene>& others, double threshold_mm) {
  std::vector<Detection> found;
  for (std::size_t k = 0; k < others.size(); ++k) {
    Detection detection{.scene = others[k].name};
    for (const TouchTrial& trial : trials) {
      if (trial.scene != k + 1 || static_cast<double>(trial.plate_motion_mm) < threshold_mm) continue;
      ++detection.motions;
      detection.unexplained += trial.explained < explained_above;
    }
    detection.unexplained /= std::max(1.0, static_cast<double>(detection.motions));
    found.push_back(detection);
  }
  return found;
}

std::string detection_table(const std::vector<Detection>& detections) {
  std::string table;
  for (const Detection& detection : detections) {
    char text[160];
    std::snprintf(text, sizeof text, "  scene %s: %zu motions, %.1f %% of them unexplained\n", detection.scene.c_str(),
                  detection.motions, 100 * detection.unexplained);
    table += text;
  }
  return table;
}

}  // namespace

TouchTraining train_touch(const FingerSpec& spec, const FemDataset& dataset, const PlatePriorData& prior_data,
                          const TouchTrainingPlan& plan, const TouchSource& source) {
  const PlatePrior prior = prior_data.view();
  const std::vector<FemState> states = valid_states(dataset.states), others = valid_states(dataset.others);
  const std::uint64_t seed = 1000 * plan.seed;
  std::array<Run, 3> runs;
  auto& [random_run, paths_run, final_run] = runs;
  random_run.tested = "held-out states";
  random_run.split = without_states(states, seed);
  random_run.split.other_train = others;
  paths_run.tested = "held-out paths";
  paths_run.split = without_paths(states, others);
  final_run.split.train = states;
  final_run.split.other_train = others;
  final_run.split.test = valid_states(dataset.kept);
  Progress progress("touch network", runs.size() * static_cast<std::size_t>(plan.steps));
  const TouchSource between_states = [&](const std::vector<FemState>& some, const std::vector<FemState>&,
                                         std::size_t count, Random& random) {
    return draw_touches(spec, StateInterpolant(some), count, random);
  };
  const TouchSource& touches = source ? source : between_states;
  parallel_for(runs.size(),
               [&](std::size_t i) { train(runs[i], spec, prior, plan, touches, seed + 10 * i, progress); });

  TouchTraining result;
  const std::vector<TouchTrial> random_raw = random_run.noisy_trials(spec, prior, seed);
  const Calibration by_states = calibrate(random_raw, spec.threshold_mm);
  apply(by_states, random_run.trained->model);
  result.random_clean = score(random_run.clean_trials(prior), spec.threshold_mm);
  result.random_noisy = score(cross_calibrated(random_raw, spec.threshold_mm), spec.threshold_mm);

  const std::vector<TouchTrial> raw = paths_run.noisy_trials(spec, prior, seed);
  const Calibration by_paths = calibrate(raw, spec.threshold_mm);
  apply(by_paths, paths_run.trained->model);
  // Where every state has contacts of its own, a state that is held out meets the network as any new touch does: what
  // was learnt lies around it, a little thinner. A path that is held out leaves a hole, and its touches lie deep in it.
  const bool is_alone = contacts_change(spec.scene(dataset.plan.scene));
  Run& calibrated = is_alone ? random_run : paths_run;
  const Calibration& calibration = is_alone ? by_states : by_paths;
  apply(calibration, final_run.trained->model);
  final_run.trained->model.explained_above_unknown_g =
      explained_limit(calibrated.turned_trials(spec, prior, seed), spec.threshold_mm);
  std::vector<TouchTrial> kept = final_run.noisy_trials(spec, prior, seed, {true, true, true}, kKeptRepeats);
  std::ranges::copy(final_run.turned_trials(spec, prior, seed), std::back_inserter(kept));
  fit_radius_network(kept, spec.threshold_mm, final_run.trained->model);
  const std::vector<TouchTrial> noisy = cross_calibrated(raw, spec.threshold_mm);
  result.held_out_clean = score(paths_run.clean_trials(prior), spec.threshold_mm);
  result.held_out_noisy = score(noisy, spec.threshold_mm);
  result.held_out_from_4_mm = score(noisy, std::max(4.0, spec.threshold_mm));
  result.bands = error_bands(noisy);
  result.force_bands = force_bands(noisy, spec.threshold_mm);
  result.coverage_curve = coverage_curve(noisy, spec.threshold_mm);
  result.quantisation = quantisation_cost(noisy, spec.threshold_mm);
  const float explained_above = final_run.trained->model.explained_above;
  result.detections = detections(paths_run.other_trials(spec, prior, seed), explained_above,
                                 other_scenes(spec, dataset.plan), spec.threshold_mm);
  const std::string with_missing_plates = calibrate_missing_plates(calibrated, spec, prior, seed);
  final_run.trained->model.seen_factor = calibrated.trained->model.seen_factor;
  result.model = final_run.trained->model;

  char text[400];
  std::snprintf(text, sizeof text,
                "%zu states\ncalibration: deviations of force and moment times %.2f %.2f %.2f %.2f %.2f %.2f; int8 "
                "moves the point by %.3f mm "
                "(mean; worst %.2f mm), mean error %.3f mm in floats, %.3f mm in int8\n",
                states.size(), calibration.wrench[0], calibration.wrench[1], calibration.wrench[2],
                calibration.wrench[3], calibration.wrench[4], calibration.wrench[5], result.quantisation.mean_mm,
                result.quantisation.worst_mm, result.quantisation.float_error_mm, result.quantisation.int8_error_mm);
  result.log = text + line("held-out states, clean", result.random_clean) +
               line("held-out paths, clean", result.held_out_clean) +
               line("held-out states, noisy", result.random_noisy) +
               line("held-out paths, noisy", result.held_out_noisy) +
               line("  from 4 mm of plate motion", result.held_out_from_4_mm) + error_table(result.bands) +
               force_table(result.force_bands) + detection_table(result.detections) + with_missing_plates;
  return result;
}

}  // namespace finsight::host
