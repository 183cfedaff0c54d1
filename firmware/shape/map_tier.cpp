#include "firmware/shape/map_tier.h"

namespace finsight {

void answer_by_map(std::span<const float> map_mm, const PlatePoses& poses, ShapeState<float>& state,
                   FingerShape& shape) {
  const bool usable = state.start_from(map_mm, poses);
  if (!usable) state.start_towards(map_mm, poses);
  shape.source = ShapeSource::kMap;
  shape.fallback = !usable || state.is_overstrained();
}

}  // namespace finsight
