// How a device sees its finger move otherwise than the pack's finger moves under the same touch.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "firmware/loop/finger_fit.h"
#include "hostgen/finger/jig_holes.h"
#include "hostgen/fit/pressed_place.h"

namespace finsight::host {

using MotionChange = Eigen::Matrix<double, kPoseDims, kPoseDims>;

/// One way in which a finger and its camera may differ from their spec: motions are seen changed by `amount * change`
/// times themselves.
struct Deviation {
  std::string name, unit;
  double usual = 0;  ///< standard deviation of the amount, of what a workshop makes and a zero does not tell
  MotionChange change = MotionChange::Zero();
};

struct MotionBasis {
  std::vector<PressedPlace> holes;  ///< of the pack's finger, in the order of the jig's
  std::vector<Deviation> deviations;
};

/// Camera and markers by geometry; walls by solving fingers with another one each at the holes with finite elements,
/// 9 s on two cores. Throws as FingerStatics does.
MotionBasis motion_basis(const FingerSpec& spec, const std::vector<JigHole>& holes);

/// Of a weight.
struct SeenMotion {
  std::size_t hole = 0;  ///< from 0
  PoseVectorOf<double> motion;
};

struct MotionFit {
  /// To be added to seen motions: this times them. Zero where nothing was seen.
  MotionChange correction = MotionChange::Zero();
  std::vector<double> amount, sigma;  ///< of each deviation
  std::vector<double> force_n;        ///< of each weight: what would have moved the pack's finger alike
  /// RMS of what corrected motions are off by, as far as the weights tell: what is left of them, and what stays open
  /// about the deviations; a share of the plates' motion.
  double unlike = 0;
};

/// Bayesian least squares in the deviations; how hard each weight pulls is left open, since stiffness is not known.
MotionFit fit_motions(const MotionBasis& basis, std::span<const SeenMotion> seen);

}  // namespace finsight::host
