#include "firmware/loop/gravity.h"

namespace finsight {

GravityCorrection::GravityCorrection(const TouchModel& model, const std::optional<Vec3f>& fixed_g)
    : per_g_(Eigen::Map<const Eigen::Matrix<float, kPoseDims, 3, Eigen::RowMajor>>(model.per_g.data())),
      is_fixed_(fixed_g.has_value()),
      felt_g_(fixed_g),
      at_zero_g_(fixed_g) {}

float GravityCorrection::apply(bool is_zeroed, PlatePoses& poses) const {
  if (!felt_g_ || (is_zeroed && !at_zero_g_)) return is_zeroed ? kUnknownSinceZero_g : kUnknown_g;
  if (is_fixed_ && is_zeroed) return 0;
  const Vec3f before_g = is_zeroed ? *at_zero_g_ : Vec3f::Zero();
  const Vec3f change_g = *felt_g_ - before_g;
  const PoseVector motion = per_g_ * change_g;
  for (int p = 0; p < kPlates; ++p) {
    PlateMotion& plate = poses.plates[static_cast<std::size_t>(p)];
    plate.displacement_mm -= motion.segment<3>(6 * p);
    plate.rotation_rad -= motion.segment<3>(6 * p + 3);
  }
  const float changed_g = change_g.norm(), summed_g = (*felt_g_ + before_g).norm();
  return (is_fixed_ ? 0 : kKnown_g) + kKnownChange * changed_g + kKnownChangeOfSquare_per_g * changed_g * summed_g;
}

}  // namespace finsight
