// MarkerCorners -> PlatePoses.
#pragma once

#include <optional>

#include "firmware/geometry/lens.h"
#include "firmware/model/model.h"
#include "firmware/vision/edge_corners.h"
#include "firmware/vision/plate_estimator.h"
#include "firmware/vision/rigid_motion_fit.h"

namespace finsight {

enum class PoseMethod : std::uint8_t {
  kJoint,     ///< all plates at once from all corners, with the prior, which tells the squares' mirror poses apart
  kPublished  ///< the paper's way: every marker alone by IPPE, whichever of its two poses fits the corners better
};

class PoseStage {
 public:
  /// Throws InputError for an impossible lens and for a prior that is not a positive definite Gaussian.
  PoseStage(const MountModel& mount, const PlatePrior& prior, const Lens& camera,
            PoseMethod method = PoseMethod::kJoint);
  PoseStage(const Model& model, const Lens& camera) : PoseStage(model.mount, model.prior, camera) {}

  /// Where this finger rests, as far as it is known, and whether that is being measured now: nothing touches the
  /// finger.
  void set_rest(const ZeroPose& rest, bool is_measured_now) {
    estimator_.set_rest(rest);
    is_at_rest_ = is_measured_now;
  }
  /// Motions of all plates. A marker counts as not seen, whatever `corners` says, if no square in front of the camera
  /// explains its corners to 3 pixels, or if its plate would be far from where the plates of touched fingers are.
  /// `edges`: how well each marker was seen; by default as well as any.
  /// Plates that are not seen are completed from the prior. Fresh if at least one is seen, otherwise invalid (and at
  /// rest). Neither throws nor allocates.
  const PlatePoses& estimate(const MarkerCorners& corners, const std::array<EdgeQuality, kPlates>& edges = {});
  /// From the corners of the last estimate: the one motion of the whole finger, counted from `zero`, that explains them
  /// best.
  RigidMotionFit rigid_motion(const ZeroPose& zero) const { return rigid_motion_.fit(sight_, zero); }
  /// Where a marker's corners should be in the image, by the last estimate: for a plate that was not seen, by the
  /// others and the prior. Nothing where that is behind the camera or beyond the image.
  std::optional<std::array<Vec2f, 4>> expected_corners(std::size_t plate) const;

 private:
  using Vector = PlateEstimator::Vector;
  void unproject_corners(const MarkerCorners& corners, const std::array<EdgeQuality, kPlates>& edges);
  Vector estimate_jointly();
  Vector estimate_one_by_one() const;
  bool drop_worst(const Vector& motion);

  Lens camera_;
  float marker_size_mm_;
  PlatePrior prior_;
  PlateEstimator estimator_;
  RigidMotionFitter rigid_motion_;
  PoseMethod method_;
  PlateSight sight_;
  std::array<SquarePoses, kPlates> squares_;  ///< of the seen plates: at least one pose each
  PlatePoses poses_;
  Vector motion_ = Vector::Zero();  ///< of the last estimate
  double turning_radius_sq_;
  bool is_at_rest_ = false;
};

}  // namespace finsight
