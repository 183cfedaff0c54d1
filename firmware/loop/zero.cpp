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
  sum_ = block_ = {};
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

/// Near enough to the model's rest.
bool Zeroing::is_usable(const PlatePoses& poses) const {
  return std::ranges::all_of(poses.plates, [&](const PlateMotion& motion) {
    return motion.displacement_mm.norm() <= furthest_mm_ && motion.rotation_rad.norm() <= kMaxRotation_rad;
  });
}

// Single frames differ by their noise, which for a small marker is a tenth of a millimetre along the line of sight; a
// finger that is still shows it in the means of some.
bool Zeroing::has_moved() const {
  for (std::size_t p = 0; p < kPlates; ++p) {
    if ((block_[p].displacement_mm - first_block_[p].displacement_mm).norm() > kMaxMotion_mm) return true;
  }
  return false;
}

void Zeroing::add(const PlatePoses& poses) {
  if (++tries_ > kMaxFrames) return end(false);
  if (poses.quality != Quality::kFresh || poses.seen_count() < kPlates) return;
  if (!is_usable(poses)) return end(false);
  ++frames_;
  for (std::size_t p = 0; p < kPlates; ++p) {
    sum_[p].displacement_mm += poses.plates[p].displacement_mm / kFrames;
    sum_[p].rotation_rad += poses.plates[p].rotation_rad / kFrames;
    block_[p].displacement_mm += poses.plates[p].displacement_mm / kBlock;
  }
  if (frames_ % kBlock == 0) {
    if (frames_ == kBlock) first_block_ = block_;
    if (has_moved()) return end(false);
    block_ = {};
  }
  if (frames_ < kFrames) return;
  set_zero(sum_);
  end(true);
}

}  // namespace finsight
