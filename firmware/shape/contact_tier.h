// Tier contact: the contact map's shape, which has the dimple under the touch that the plates cannot see.
#pragma once

#include "firmware/shape/map_tier.h"

namespace finsight {

class ContactTier final : public ShapeTier {
 public:
  explicit ContactTier(const ShapeParts& parts)
      : state_(parts.shape, parts.mount), contact_map_(parts.contact_map, parts.shape), map_(parts.map, parts.shape) {}

  /// The shape map answers where the plates are moved otherwise or further than the contact map's training had them, or
  /// where its shape has an inverted tetrahedron or more strain than any touch causes.
  void solve(const PlateMotions& plates, const PoseVector& motion, bool is_explained, FingerShape& shape) override {
    const RigidPlates& rigid_plates = state_.rigid_plates();
    if (is_explained && contact_map_.covers(motion) &&
        state_.start_from(contact_map_.evaluate(plates, motion, rigid_plates), plates) && !state_.is_overstrained()) {
      shape.source = ShapeSource::kContactMap;
      return;
    }
    answer_by_map(map_.evaluate(plates, motion, rigid_plates), plates, state_, shape);
  }
  std::span<const float> node_mm() const override { return state_.node_mm(); }

 private:
  ShapeState<float> state_;
  MapShape contact_map_, map_;
};

}  // namespace finsight
