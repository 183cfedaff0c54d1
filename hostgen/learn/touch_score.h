// Tests a trained touch network through the firmware's own touch stage.
#pragma once

#include <string>
#include <vector>

#include "firmware/touch/radius_network.h"
#include "hostgen/learn/touch_network.h"

namespace finsight::host {

/// One measurement of one state.
struct TouchTrial {
  std::int32_t path = 0;
  Vec3f truth_mm = Vec3f::Zero(), error_mm = Vec3f::Zero();
  float plate_motion_mm = 0, radius_68_mm = 0, force_n = 0;
  float quantisation_mm = 0;  ///< distance between the float network's point and the published one
  float float_error_mm = 0;   ///< error of the float network's point
  float explained = 0;        ///< Touch::explained
  std::uint8_t scene = 0;     ///< FemState::scene
  bool gravity_is_known = true;
  RadiusFeatures radius_features = {};
  /// Force (normal, across, along; N) and moment (x, y, z; N m).
  Eigen::Array<float, 6, 1> wrench_error = Eigen::Array<float, 6, 1>::Zero(), wrench_sigma = wrench_error;
};

/// How the states of trials are measured.
struct Measuring {
  float noise = 1;  ///< times the spec's; 0: clean poses, announced to the network as hardly noisy
  std::array<bool, kPlates> seen = {true, true, true};
  int repeats = 1;
  std::uint64_t seed = 0;
  bool gravity_is_known = true;  ///< else the finger is turned after its zero, anyhow, and the device is not told
};

/// Measures every state and locates its touch with the quantised network, even below the threshold.
std::vector<TouchTrial> run_trials(TouchNetwork& trained, const std::vector<FemState>& states,
                                   const std::array<PoseNoise, kPlates>& noise, const PlatePrior& prior,
                                   const Measuring& how);

/// Makes the radius hold 68 % of the errors, and twice the radius about 95 %, in every band of plate motion
/// (error_bands), and the standard deviations of force and moment 68.3 % each. Fitted to trials of an uncalibrated
/// network at or above the threshold; without trials nothing changes.
struct Calibration {
  std::vector<float> radius_curve = {0, 0, 1};  ///< TouchModel::radius_curve
  std::array<double, 6> wrench = {1, 1, 1, 1, 1, 1};
  float explained_above = -1e6F;  ///< explained_limit()
};
Calibration calibrate(const std::vector<TouchTrial>& trials, double threshold_mm);
void apply(const Calibration& calibration, TouchModelData& model);

/// The log-odds of being explained that one trial in a thousand is below, of those at or above the threshold; without
/// trials so low that none is.
float explained_limit(const std::vector<TouchTrial>& trials, double threshold_mm);

/// Errors and coverage of the trials at or above the threshold.
TouchScore score(const std::vector<TouchTrial>& trials, double threshold_mm);
/// Calibrates each half of the paths with the calibration fitted to the other half, so that coverage can be
/// counted on touches that the calibration has not seen. trials: uncalibrated
std::vector<TouchTrial> cross_calibrated(const std::vector<TouchTrial>& trials, double threshold_mm);

/// By how much calibrated radii are too small to hold 68 % of the errors of these trials, at or above the threshold.
float radius_factor(const std::vector<TouchTrial>& trials, double threshold_mm);
/// Multiplies the radii of each half of the paths by the factor of the other half.
void scale_cross_fitted(std::vector<TouchTrial>& trials, double threshold_mm);

/// Errors by plate motion, in bands from 0, 1, 2, 4, 7 and 12 mm; bands without trials are left out.
std::vector<TouchBand> error_bands(const std::vector<TouchTrial>& trials);
/// Force errors by force, in bands of one newton, of trials at or above the threshold.
std::vector<ForceBand> force_bands(const std::vector<TouchTrial>& trials, double threshold_mm);
/// Shares of errors inside k radii, for k = 0.1, 0.2 ... 3, of trials at or above the threshold.
std::vector<double> coverage_curve(const std::vector<TouchTrial>& trials, double threshold_mm);
/// Effect of rounding to int8, on trials at or above the threshold.
Quantisation quantisation_cost(const std::vector<TouchTrial>& trials, double threshold_mm);

/// These figures as text for the log.
std::string error_table(const std::vector<TouchBand>& bands);
std::string force_table(const std::vector<ForceBand>& bands);

}  // namespace finsight::host
