#include "firmware/shape/map_tier.h"

namespace finsight {

void answer_by_map(std::span<const float> map_mm, const PlateMotions& plates, ShapeState<float>& state,
                   FingerShape& shape) {
  const bool usable = state.start_from(map_mm, plates);
  if (!usable) state.start_towards(map_mm, plates);
  shape.source = ShapeSource::kMap;
  shape.fallback = !usable || state.is_overstrained();
}

}  // namespace finsight
