#include "hostgen/fit/pressed_place.h"

namespace finsight::host {

PressedPlace::PressedPlace(FingerStatics& statics, const Vec3f& point_mm, double highest_n, int levels)
    : point_mm_(point_mm) {
  statics.reset();
  for (int i = 1; i <= levels; ++i) {
    const double force_n = highest_n * i / levels;
    if (!statics.load(point_mm, force_n)) return;
    const FemState state = statics.state();
    if (!state.valid()) return;
    point_mm_ = state.point_mm;
    PlatePoses poses{.plates = state.plates};
    force_n_.push_back(force_n);
    per_newton_.push_back(pose_vector(poses).cast<double>() / force_n);
  }
}

// Motion over force changes slowly and has a limit at rest: the polynomial through all of them.
std::array<PlateMotion, kPlates> PressedPlace::plates(double force_n) const {
  PoseVectorOf<double> sum = PoseVectorOf<double>::Zero();
  for (std::size_t i = 0; i < force_n_.size(); ++i) {
    double weight = 1;
    for (std::size_t j = 0; j < force_n_.size(); ++j) {
      if (j != i) weight *= (force_n - force_n_[j]) / (force_n_[i] - force_n_[j]);
    }
    sum += weight * per_newton_[i];
  }
  const PoseVector numbers = (force_n * sum).cast<float>();
  return seen_poses({numbers.data(), kPoseDims}).plates;
}

}  // namespace finsight::host
