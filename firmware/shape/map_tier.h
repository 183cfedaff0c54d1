// Tier map: the shape map's shape, checked.
#pragma once

#include <vector>

#include "firmware/shape/shape_map.h"
#include "firmware/shape/shape_state.h"
#include "firmware/shape/shape_tier.h"

namespace finsight {

/// A map's shape with the plates exactly where they are: the map itself keeps them only nearly rigid.
class MapShape {
 public:
  MapShape(const ShapeMapModel& map, const ShapeModel& shape) : map_(map, shape), node_mm_(shape.rest_mm.size()) {}

  /// [3 * nodes], valid until the next call. Nothing is checked: tetrahedra may be inverted.
  std::span<const float> evaluate(const PlateMotions& plates, const PoseVector& motion,
                                  const RigidPlates& rigid_plates) {
    map_.evaluate(motion, node_mm_);
    rigid_plates.place<float>(plates, node_mm_);
    return node_mm_;
  }
  bool covers(const PoseVector& motion) const { return map_.covers(motion); }

 private:
  ShapeMap map_;
  std::vector<float> node_mm_;
};

/// Brings `state` to the map's shape [3 * nodes]. A shape with an inverted tetrahedron is never shown: the way from
/// rest to it is, as far as it is possible, and marked as a fallback like one that no touch causes.
void answer_by_map(std::span<const float> map_mm, const PlateMotions& plates, ShapeState<float>& state,
                   FingerShape& shape);

class MapTier final : public ShapeTier {
 public:
  explicit MapTier(const ShapeParts& parts) : state_(parts.shape, parts.mount), map_(parts.map, parts.shape) {}

  void solve(const PlateMotions& plates, const PoseVector& motion, bool, FingerShape& shape) override {
    answer_by_map(map_.evaluate(plates, motion, state_.rigid_plates()), plates, state_, shape);
  }
  std::span<const float> node_mm() const override { return state_.node_mm(); }

 private:
  ShapeState<float> state_;
  MapShape map_;
};

}  // namespace finsight
