// Known weights at known holes of the jig -> what one finger does otherwise than its pack.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "firmware/loop/finger_fit.h"
#include "hostgen/finger/jig_holes.h"
#include "hostgen/fit/motion_fit.h"
#include "hostgen/fit/pack_error.h"
#include "hostgen/fit/touch_reading.h"

namespace finsight::host {

/// One recording: the untouched finger, then a weight that hangs at a hole, perhaps for long.
struct WeightRecord {
  std::string name;
  int hole = 0;        ///< number of the jig's hole
  double force_n = 0;  ///< of the weight
  std::vector<TouchReading> readings;
  /// How far a plate stood from its untouched place when the recording began; nothing: not known.
  std::optional<double> left_mm = std::nullopt;
};

/// What a recording shows while the weight hangs.
struct WeightHold {
  std::string name;
  int hole = 0;
  double force_n = 0;
  double began_s = 0, lasted_s = 0;
  double elastic_n = 0;            ///< force that would have bent a finger without hysteresis so
  double pack_force_n = 0;         ///< by the pack, without creep
  Vec3f point_mm = Vec3f::Zero();  ///< mean
  Vec3f truth_mm = Vec3f::Zero();  ///< the hole's contact point
  PackError pack_error{};          ///< of the finger that the pack was made for, under as much force
  float plate_motion_mm = 0;
  float explained = 0;                   ///< of the least likely reading, see TouchReading
  double force_error = 0;                ///< relative, once fitted
  Vec3f touch_error_mm = Vec3f::Zero();  ///< once fitted
};

struct WeightFit {
  FitValues values;
  double creep_share_sigma = 0;
  std::vector<WeightHold> holds;
  MotionFit motions;                ///< in the order of FitBasis::motions
  std::vector<std::string> untold;  ///< what the recordings do not tell, in words
};

/// What a fit needs to know of the finger that the pack was made for.
struct FitBasis {
  std::vector<JigHole> holes;
  MotionBasis motions;
  const Model* model = nullptr;  ///< reads motions again once they are fitted; null: they are not
  std::uint32_t model_checksum = 0;
  Eigen::Matrix3f face_axes = Eigen::Matrix3f::Identity();  ///< columns normal, across, along
  Vec3f face_middle_mm = Vec3f::Zero();
  std::array<float, 2> face_half_mm{1, 1};
  float force_range_n = 1;
  float force_tolerance = 0, touch_tolerance_mm = 0;  ///< of fingers that are not fitted
  float noise_per_mm = 0;                             ///< see TouchModel
  float explained_above = 0;                          ///< log-odds below which the pack calls motions unexplained
};
/// All but the motions, for which the finger is solved by finite elements: see motion_basis(). The model must outlive
/// it.
FitBasis fit_basis(const FingerSpec& spec, const Model& model);

/// With what a device reads weights: it is not fitted, and takes whatever moves the plates for a touch.
FitValues weighing(const TouchModel& touch);

/// What fit_weights() checks of its recordings, without the motions: throws the same InputError.
void check_weights(const FitBasis& basis, const std::vector<WeightRecord>& records);

/// Bayesian least squares: few recordings tell little and leave the rest to what fingers of a workshop have in common
/// (see Workshop). `records` were read by a device with weighing(). Throws InputError naming the recording that shows
/// no touch, or that contradicts the spec or the others: at another hole, or with another weight.
WeightFit fit_weights(const FitBasis& basis, const std::vector<WeightRecord>& records, std::uint16_t today);

}  // namespace finsight::host
