#include "firmware/loop/zero.h"

#include <algorithm>
#include <cmath>

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
  change_sq_ = {};
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

/// This block's mean is near enough to the model's rest. Single frames of dim pictures scatter further.
bool Zeroing::is_usable() const {
  return std::ranges::all_of(block_, [&](const PlateMotion& motion) {
    return motion.displacement_mm.norm() <= furthest_mm_ && motion.rotation_rad.norm() <= kMaxRotation_rad;
  });
}

// Of a single frame, all three axes together, from the changes between frames that follow each other: a slow drift does
// not count as noise.
float Zeroing::place_variance(std::size_t plate) const {
  return frames_ > 1 ? change_sq_[plate] / static_cast<float>(2 * (frames_ - 1)) : 0;
}

// Single frames differ by their noise, which for a small marker is a tenth of a millimetre along the line of sight; a
// finger that is still shows it in the means of some.
bool Zeroing::has_moved() const {
  for (std::size_t p = 0; p < kPlates; ++p) {
    const float noise_mm = std::sqrt(2 * place_variance(p) / kBlock);
    const float moved_mm = (block_[p].displacement_mm - first_block_[p].displacement_mm).norm();
    if (moved_mm > std::max(kMaxMotion_mm, kMaxMotion_sigmas * noise_mm)) return true;
  }
  return false;
}

void Zeroing::add(const PlatePoses& poses) {
  if (++tries_ > kMaxFrames) return end(false);
  if (poses.quality != Quality::kFresh || poses.seen_count() < kPlates) return;
  ++frames_;
  float worst_variance = 0;
  for (std::size_t p = 0; p < kPlates; ++p) {
    const PlateMotion& now = poses.plates[p];
    if (frames_ > 1) change_sq_[p] += (now.displacement_mm - last_[p].displacement_mm).squaredNorm();
    last_[p] = now;
    sum_[p].displacement_mm += now.displacement_mm;
    sum_[p].rotation_rad += now.rotation_rad;
    block_[p].displacement_mm += now.displacement_mm / kBlock;
    block_[p].rotation_rad += now.rotation_rad / kBlock;
    worst_variance = std::max(worst_variance, place_variance(p));
  }
  if (frames_ % kBlock == 0) {
    if (frames_ == kBlock) first_block_ = block_;
    if (!is_usable() || has_moved()) return end(false);
    block_ = {};
  }
  const auto count = static_cast<float>(frames_);
  if (frames_ < kFrames || std::sqrt(worst_variance / count) > kMaxMeanError_mm) return;
  ZeroPose mean = sum_;
  for (PlateMotion& plate : mean) {
    plate.displacement_mm /= count;
    plate.rotation_rad /= count;
  }
  set_zero(mean);
  end(true);
}

}  // namespace finsight
