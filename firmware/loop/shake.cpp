#include "firmware/loop/shake.h"

namespace finsight {

float Shake::update(const PlatePoses& poses, std::uint32_t sequence) {
  if (sequence - largest_sequence_ > kLastingFrames) largest_mm_ = 0;
  if (poses.quality != Quality::kFresh) return largest_mm_;
  const auto& [before, long_before] = last_;
  const bool in_a_row = sequence - before.sequence == 1 && before.sequence - long_before.sequence == 1;
  for (std::size_t p = 0; p < kPlates && in_a_row; ++p) {
    if (!poses.seen[p] || !before.poses.seen[p] || !long_before.poses.seen[p]) continue;
    const float second_mm = (poses.plates[p].displacement_mm - 2 * before.poses.plates[p].displacement_mm +
                             long_before.poses.plates[p].displacement_mm)
                                .norm();
    if (!(second_mm >= kMin_mm && second_mm >= largest_mm_)) continue;
    largest_mm_ = second_mm;
    largest_sequence_ = sequence;
  }
  last_ = {Sample{poses, sequence}, before};
  return largest_mm_;
}

}  // namespace finsight
