// Plate motions as the firmware makes them of an image: noisy corners, then the joint estimate.
#pragma once

#include <array>

#include "firmware/model/plate_prior.h"
#include "firmware/vision/plate_estimator.h"
#include "hostgen/finger/spec.h"
#include "hostgen/util/random.h"

namespace finsight::host {

/// The errors of a joint estimate hang together over all plates, unlike the spec's noise: where corners say little, the
/// prior decides. A network that is to read estimates has to learn from estimates.
class CornerMeasurement {
 public:
  /// The arrays that `prior` views must live as long.
  CornerMeasurement(const FingerSpec& spec, const PlatePrior& prior);

  /// What the image says of plates that truly moved by `numbers`, which it replaces (those not seen are completed),
  /// and how large the noise of each seen plate is (PlatePoses::noise). Corners scatter by 0.01 to 0.4 pixels, one of
  /// the spec's image sizes.
  std::array<float, kPlates> measure(const std::array<bool, kPlates>& seen, Random& random,
                                     PoseVector& numbers) const;

 private:
  struct View {
    double focal_px;
    PlateEstimator estimator;
  };
  FingerSpec spec_;
  std::array<View, 2> views_;
};

}  // namespace finsight::host
