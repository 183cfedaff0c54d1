#include "firmware/loop/grip_watch.h"

#include <algorithm>
#include <cmath>

namespace finsight {

void GripWatch::Sums::add(const Touch& touch, float deformation_mm) {
  ++frames;
  deformation += static_cast<double>(deformation_mm);
  deformation_sq += static_cast<double>(deformation_mm) * static_cast<double>(deformation_mm);
  if (touch.quality != Quality::kFresh) return;
  ++touches;
  point_mm += touch.point_mm;
}

double GripWatch::Sums::variance() const { return std::max(deformation_sq / frames - mean() * mean(), 0.0); }

bool GripWatch::update(bool in_contact, const Touch& touch, float deformation_mm, float changes) {
  if (!in_contact || changes <= 0) {
    reset();
    return false;
  }
  if (!is_steady_) {
    collect(touch, deformation_mm);
    return false;
  }
  if (!has_changed(touch, deformation_mm, changes)) return false;
  reset();
  return true;
}

void GripWatch::collect(const Touch& touch, float deformation_mm) {
  (first_.frames < kFrames / 2 ? first_ : second_).add(touch, deformation_mm);
  if (second_.frames < kFrames / 2) return;
  take_reference();
  first_ = second_ = {};
}

// Noise alone moves the mean of one half against the other's by more than one deviation in 1 of 160 windows; a steady
// movement by 1.7 deviations, because these are then mostly the movement itself. Then the next window is tried.
void GripWatch::take_reference() {
  const double between = (second_.mean() - first_.mean()) / 2;
  const double deviation = std::sqrt((first_.variance() + second_.variance()) / 2 + between * between);
  deviation_mm_ = std::max(static_cast<float>(deviation), kLeastDeviation_mm);
  if (static_cast<float>(std::abs(2 * between)) > deviation_mm_) return;
  is_steady_ = true;
  deformation_mm_ = recent_deformation_mm_ = static_cast<float>((first_.mean() + second_.mean()) / 2);
  has_touch_ = first_.touches > 0 && second_.touches > 0;
  if (has_touch_) point_mm_ = recent_point_mm_ = (first_.mean_point() + second_.mean_point()) / 2;
}

bool GripWatch::has_changed(const Touch& touch, float deformation_mm, float changes) {
  recent_deformation_mm_ += (deformation_mm - recent_deformation_mm_) / kMeanFrames;
  if (std::abs(recent_deformation_mm_ - deformation_mm_) > changes * deviation_mm_) return true;
  if (!has_touch_ || touch.quality != Quality::kFresh) return false;
  recent_point_mm_ += (touch.point_mm - recent_point_mm_) / kMeanFrames;
  return (recent_point_mm_ - point_mm_).norm() > changes * touch.radius_68_mm;
}

}  // namespace finsight
