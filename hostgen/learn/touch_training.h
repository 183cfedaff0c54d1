// Trains the touch network on finite-element states with pose noise, and quantises it.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "firmware/model/model.h"
#include "hostgen/fem/dataset.h"
#include "hostgen/learn/state_interpolant.h"
#include "hostgen/util/random.h"

namespace finsight::host {

/// Owns what a PlatePrior views.
struct PlatePriorData {
  std::vector<float> mean, covariance, noise;
  PlatePrior view() const;
};
/// Gaussian over the measured plate numbers of all valid states and their scaled-down copies (the finger starts from
/// rest), and the spec's noise, with standard deviations of at least 1e-6 (mm, rad). Positive definite. Throws
/// std::runtime_error if no state is valid.
PlatePriorData fit_plate_prior(const FemDataset& dataset, const std::array<PoseNoise, kPlates>& noise);

/// Owns what a DenseFloat views; zeros to begin with.
struct LayerData {
  int inputs = 0, outputs = 0;
  std::vector<float> weights = std::vector<float>(static_cast<std::size_t>(inputs * outputs), 0.0F);
  std::vector<float> bias = std::vector<float>(static_cast<std::size_t>(outputs), 0.0F);
  DenseFloat view() const { return {inputs, outputs, weights, bias}; }
  bool operator==(const LayerData&) const = default;
};

/// Owns what a TouchModel views.
struct TouchModelData {
  std::vector<float> scale, input_mean, input_scale, output_mean, output_scale;
  std::vector<float> radius_curve = {0, 0, 1};  ///< uncalibrated
  /// Answers 1.
  std::vector<float> radius_inputs = std::vector<float>(2 * TouchModel::kRadiusFeatures, 0.0F);
  std::array<LayerData, 3> radius = {LayerData{TouchModel::kRadiusFeatures, TouchModel::kRadiusHidden},
                                     LayerData{TouchModel::kRadiusHidden, TouchModel::kRadiusHidden},
                                     LayerData{TouchModel::kRadiusHidden, 1}};
  std::vector<float> seen_factor = std::vector<float>(TouchModel::kSeenPatterns, 1.0F);
  std::vector<float> face_axes = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  std::vector<float> per_g = std::vector<float>(3 * kPoseDims, 0.0F);
  std::vector<float> per_g_change = std::vector<float>(3 * kPoseDims * kBentFeatures, 0.0F);
  LayerData first, last;
  std::array<std::vector<std::int8_t>, TouchModel::kRounded> weights;  ///< of the layers between, rounded
  std::array<std::vector<float>, TouchModel::kRounded> weight_scale, bias;
  float threshold_mm = 0, range_mm = 0;
  float explained_above = -1e6F, explained_above_unknown_g = -1e6F;  ///< everything
  float stiffness_tolerance = 0, marker_tolerance_mm = 0, marker_tolerance_rad = 0, touch_tolerance_mm = 0,
        noise_per_mm = 0;
  TouchModel view() const;
};

/// Errors of the published (int8) touches on states that were not trained on and whose measured plate motion reaches
/// the threshold. Arrays: x, y, z of the touched point.
struct TouchScore {
  std::array<double, 3> rmse_mm{}, r2{};
  double mean_mm = 0;
  double coverage_68 = 0, coverage_95 = 0;  ///< share of errors inside one and two published radii
  std::size_t touches = 0;                  ///< how many were published
  /// Force (normal, across, along; N) and moment (x, y, z; N m), and the share of their errors inside one deviation.
  std::array<double, 6> wrench_rmse{}, wrench_coverage_68{};
};

/// Errors of touches whose plates moved between two distances.
struct TouchBand {
  double from_mm = 0, to_mm = 0;
  std::size_t touches = 0;
  double mean_mm = 0, error_95_mm = 0;      ///< mean, and 95th percentile
  double coverage_68 = 0, coverage_95 = 0;  ///< as in TouchScore
};
/// Force errors of touches with forces between two values.
struct ForceBand {
  double from_n = 0, to_n = 0;
  std::size_t touches = 0;
  double rmse_n = 0, bias_n = 0, coverage_68 = 0;  ///< coverage: share of errors inside the published deviation
};
/// Float network against int8 network: distance between their points, and both errors.
struct Quantisation {
  double mean_mm = 0, worst_mm = 0, float_error_mm = 0, int8_error_mm = 0;
};

/// Which part of the plate motions of another scene is found not to be a touch of the pack's.
struct Detection {
  std::string scene;
  std::size_t motions = 0;  ///< held out, noisy, above the threshold
  double unexplained = 0;
};

struct TouchTraining {
  TouchModelData model;
  /// "Random": the paper's split of the states, 7:1:2. "Held out": every fifth load path, with all its states.
  TouchScore random_clean, random_noisy, held_out_clean, held_out_noisy;
  TouchScore held_out_from_4_mm;       ///< of held_out_noisy, where a plate has moved 4 mm or more
  std::vector<TouchBand> bands;        ///< held out, noisy; coverage after cross-calibration
  std::vector<ForceBand> force_bands;  ///< the same trials
  std::vector<double> coverage_curve;  ///< the same trials: shares inside 0.1, 0.2 ... 3 radii
  Quantisation quantisation;           ///< the same trials
  std::vector<Detection> detections;
  std::string log;  ///< for people
};

struct TouchTrainingPlan {
  std::uint64_t seed = 1;
  int steps = 6000;  ///< Adam steps
  int batch = 128;
  std::array<double, kPlates> plate_height_mm = {};  ///< for add_swing(); train_touch() takes the spec's
  /// What gravity does: TouchModel::per_g and per_g_change.
  std::vector<float> per_g = std::vector<float>(3 * kPoseDims, 0.0F);
  std::vector<float> per_g_change = std::vector<float>(3 * kPoseDims * kBentFeatures, 0.0F);
};

/// Draws touches for training from some of the dataset's states, and from some of those of other scenes.
using TouchSource = std::function<std::vector<TouchSample>(
    const std::vector<FemState>& states, const std::vector<FemState>& others, std::size_t count, Random& random)>;

/// Three trainings side by side: without a fifth of the states, without a fifth of the load paths, and, for the model
/// itself, with all. Training touches come from `source`, by default from an interpolant of the training states
/// (see StateInterpolant), with the spec's pose noise. The radius and the force's deviation are calibrated after
/// quantisation on the held-out states where each has contacts of its own, else on the held-out paths, and the final
/// model gets the same factors; the coverage in `random_noisy` and `held_out_noisy` comes from calibrating on one half
/// of the tested paths and counting on the other. The final model's radius network is fitted to what the set keeps from
/// learning, if it does (fit_radius_network()). The same arguments give the same bytes. What is called unexplained
/// is set on the same states: one frame in a thousand of theirs, once with and once without knowledge of gravity.
/// Throws std::runtime_error if the valid states are too few to train on, Interrupted on Ctrl-C.
TouchTraining train_touch(const FingerSpec& spec, const FemDataset& dataset, const PlatePriorData& prior,
                          const TouchTrainingPlan& plan, const TouchSource& source = {});

}  // namespace finsight::host
