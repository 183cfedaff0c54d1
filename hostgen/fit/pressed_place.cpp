#include "hostgen/fit/pressed_place.h"

namespace finsight::host {

namespace {

// Near the tip, beside its middle, a push twists the finger more and more: with three of them, interpolated motions are
// off by forty times the noise, with five by six times, with ten by less than a hundredth.
constexpr int kLevels = 10;

}  // namespace

PressedPlace::PressedPlace(FingerStatics& statics, const Vec3f& point_mm, double highest_n) : point_mm_(point_mm) {
  while (highest_n > 0 && !solve(statics, highest_n)) highest_n = this->highest_n();
}

/// False if the finger does not bear all of that.
bool PressedPlace::solve(FingerStatics& statics, double highest_n) {
  force_n_.clear();
  per_newton_.clear();
  statics.reset();
  for (int i = 1; i <= kLevels; ++i) {
    const double force_n = highest_n * i / kLevels;
    if (!statics.load(point_mm_, force_n)) return false;
    const FemState state = statics.state();
    if (!state.valid()) return false;
    point_mm_ = state.point_mm;
    force_n_.push_back(force_n);
    per_newton_.push_back(pose_vector(PlatePoses{.plates = state.plates}).cast<double>() / force_n);
  }
  return true;
}

// Motion over force changes slowly and has a limit at rest: the polynomial through all of them.
PoseVectorOf<double> PressedPlace::motion(double force_n) const {
  PoseVectorOf<double> sum = PoseVectorOf<double>::Zero();
  for (std::size_t i = 0; i < force_n_.size(); ++i) {
    double weight = 1;
    for (std::size_t j = 0; j < force_n_.size(); ++j) {
      if (j != i) weight *= (force_n - force_n_[j]) / (force_n_[i] - force_n_[j]);
    }
    sum += weight * per_newton_[i];
  }
  return force_n * sum;
}

std::array<PlateMotion, kPlates> PressedPlace::plates(double force_n) const {
  const PoseVector numbers = motion(force_n).cast<float>();
  return seen_poses({numbers.data(), kPoseDims}).plates;
}

}  // namespace finsight::host
