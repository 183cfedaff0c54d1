// Plate motions as the firmware measures them from an image: noisy corners, then the joint estimate.
#pragma once

#include <array>

#include "firmware/model/plate_prior.h"
#include "firmware/vision/plate_estimator.h"
#include "hostgen/finger/spec.h"
#include "hostgen/util/random.h"

namespace finsight::host {

/// Unlike the spec's noise, the errors of a joint estimate are correlated across all plates: where the corners say
/// little, the prior decides. A network that is to read such estimates must be trained on them.
class CornerMeasurement {
 public:
  /// The arrays that `prior` views must outlive this.
  CornerMeasurement(const FingerSpec& spec, const PlatePrior& prior);

  /// Replaces `numbers`, the plates' true motion, by what an image of them would give; plates not seen are completed
  /// from the prior. Returns the noise of each seen plate (PlatePoses::noise). Corners scatter by 0.01 to 0.4 pixels,
  /// at one of the spec's image sizes.
  std::array<float, kPlates> measure(const std::array<bool, kPlates>& seen, Random& random, PoseVector& numbers) const;

 private:
  struct View {
    double focal_px;
    PlateEstimator estimator;
  };
  FingerSpec spec_;
  std::array<View, 2> views_;
};

}  // namespace finsight::host
