#include "firmware/loop/mount_check.h"

#include <algorithm>
#include <cmath>

namespace finsight {

bool MountCheck::update(const PlatePoses& poses, const std::optional<RigidMotionFit>& fit) {
  if (!fit || poses.quality != Quality::kFresh || poses.seen_count() < kPlates) return knocked_;
  if (!std::isfinite(fit->unexplained_sq)) {
    frames_ = 0;
    return knocked_;
  }
  bool moves = false;
  for (std::size_t p = 0; p < kPlates && frames_ > 0; ++p) {
    moves |= !((poses.plates[p].displacement_mm - mean_mm_[p]).norm() <= kStill_mm);
  }
  moving_ = moves ? moving_ + 1 : 0;
  if (moves && moving_ < kBrief) return knocked_;
  if (moves) frames_ = moving_ = 0;
  if (frames_ == 0) {
    mean_mm_.fill(Vec3f::Zero());
    mean_fit_ = {};
  }
  frames_ = std::min(frames_ + 1, kFrames);
  for (std::size_t p = 0; p < kPlates; ++p) {
    mean_mm_[p] += (poses.plates[p].displacement_mm - mean_mm_[p]) / static_cast<float>(frames_);
  }
  mean_fit_.size_mm += (fit->size_mm - mean_fit_.size_mm) / frames_;
  mean_fit_.unexplained_sq += (fit->unexplained_sq - mean_fit_.unexplained_sq) / frames_;
  if (frames_ == kFrames) knocked_ = is_rigid_motion(mean_fit_);
  return knocked_;
}

}  // namespace finsight
