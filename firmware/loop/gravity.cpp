#include "firmware/loop/gravity.h"

namespace finsight {

GravityCorrection::GravityCorrection(const TouchModel& model, const std::optional<Vec3f>& fixed_g)
    : per_g_(Eigen::Map<const PerG>(model.per_g.data())),
      change_(Eigen::Map<const decltype(change_)>(model.per_g_change.data())),
      is_fixed_(fixed_g.has_value()),
      felt_g_(fixed_g),
      at_zero_g_(fixed_g) {}

// What 1 g does is that of half-way.
PoseVector GravityCorrection::bend(const PoseVector& from, const Vec3f& g) const {
  constexpr int kIterations = 2;
  PoseVector moved = per_g_ * g;
  for (int i = 0; i < kIterations; ++i) {
    const PoseVector half_way = from + 0.5F * moved;
    const Eigen::Matrix<float, 3 * kPoseDims, 1> change = change_ * bent_features(half_way);
    moved = (per_g_ + Eigen::Map<const PerG>(change.data())) * g;
  }
  return moved;
}

float GravityCorrection::apply(bool is_zeroed, PlatePoses& poses) const {
  if (!felt_g_ || (is_zeroed && !at_zero_g_)) return kUnknown_g;
  const Vec3f before_g = is_zeroed ? *at_zero_g_ : Vec3f::Zero();
  const PoseVector at_zero = bend(PoseVector::Zero(), before_g);
  add_motion(at_zero + bend(pose_vector(poses) + at_zero, -*felt_g_), poses);
  if (is_fixed_ && is_zeroed) return 0;
  return (is_fixed_ ? 0 : kKnown_g) + kUntold_per_g * felt_g_->squaredNorm();
}

}  // namespace finsight
