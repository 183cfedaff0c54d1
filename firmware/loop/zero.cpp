#include "firmware/loop/zero.h"

#include <algorithm>

#include "firmware/geometry/so3.h"

namespace finsight {

namespace {

/// The motion that takes a plate from where it is at the zero to where it is now. A point X of the plate is at
/// Z (X - c) + c + z at the zero and at R (X - c) + c + d now; so from one to the other it is turned by R Z^-1 about
/// the marker's centre and moved by d - z.
PlateMotion since(const PlateMotion& zero, const PlateMotion& now) {
  const Eigen::Matrix3f rotation = so3_exp(now.rotation_rad) * so3_exp(zero.rotation_rad).transpose();
  return {now.displacement_mm - zero.displacement_mm, so3_log(rotation)};
}

}  // namespace

void Zeroing::begin() {
  running_ = true;
  frames_ = tries_ = 0;
  sum_ = {};
  outcome_.reset();
}

bool Zeroing::apply(PlatePoses& poses) {
  if (running_) add(poses);
  const bool has_changed = std::exchange(has_changed_, false);
  if (!zero_ || poses.quality == Quality::kInvalid) return has_changed;
  for (int p = 0; p < kPlates; ++p) {
    poses.plates[p] = since((*zero_)[static_cast<std::size_t>(p)], poses.plates[p]);
  }
  return has_changed;
}

void Zeroing::end(bool done) {
  running_ = false;
  outcome_ = done;
}

/// Near enough to the model's rest, and where the first frame saw the plates.
bool Zeroing::is_usable(const PlatePoses& poses) const {
  for (int p = 0; p < kPlates; ++p) {
    const PlateMotion& motion = poses.plates[p];
    if (!(motion.displacement_mm.norm() <= furthest_mm_ && motion.rotation_rad.norm() <= kMaxRotation_rad))
      return false;
    if (frames_ == 0) continue;
    if ((motion.displacement_mm - first_.plates[p].displacement_mm).norm() > kMaxMotion_mm) return false;
  }
  return true;
}

void Zeroing::add(const PlatePoses& poses) {
  if (++tries_ > kMaxFrames) return end(false);
  if (poses.quality != Quality::kFresh || poses.seen_count() < kPlates) return;
  if (!is_usable(poses)) return end(false);
  if (frames_++ == 0) first_ = poses;
  for (int p = 0; p < kPlates; ++p) {
    PlateMotion& sum = sum_[static_cast<std::size_t>(p)];
    sum.displacement_mm += poses.plates[p].displacement_mm / kFrames;
    sum.rotation_rad += poses.plates[p].rotation_rad / kFrames;
  }
  if (frames_ < kFrames) return;
  set_zero(sum_);
  end(true);
}

}  // namespace finsight
