// Tier measures: the registers' shape figures without the shape.
#pragma once

#include "firmware/shape/map_measures.h"
#include "firmware/shape/shape_map.h"
#include "firmware/shape/shape_tier.h"

namespace finsight {

class MeasuresTier final : public ShapeTier {
 public:
  explicit MeasuresTier(const ShapeParts& parts) : map_(parts.map, parts.shape), measures_(parts.map, parts.shape) {}

  void solve(const PlateMotions&, const PoseVector& motion, bool, FingerShape& shape) override {
    const ShapeMeasures measures = measures_.measure(map_.coefficients(motion));
    shape.source = ShapeSource::kMap;
    shape.rms_mm = measures.rms_mm;
    shape.front_rms_mm = measures.front_rms_mm;
    shape.largest_mm = measures.largest_mm;
  }
  std::span<const float> node_mm() const override { return {}; }

 private:
  ShapeMap map_;
  MapMeasures measures_;
};

}  // namespace finsight
