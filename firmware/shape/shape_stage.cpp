#include "firmware/shape/shape_stage.h"

#include "firmware/input_error.h"
#include "firmware/shape/contact_tier.h"
#include "firmware/shape/map_tier.h"
#include "firmware/shape/measures_tier.h"
#include "firmware/shape/newton_tier.h"
#include "firmware/shape/shape_measures.h"

namespace finsight {

namespace {

ShapeSettings chosen(const Model& model, ShapeSettings settings) {
  settings.tier = chosen_tier(model, settings.tier);
  return settings;
}

ShapeParts parts_of(const Model& model, ShapeSettings::Tier tier) {
  if (tier == ShapeSettings::Tier::kContact && !model.contact_map) {
    throw InputError(model.file().path(), "contact map", "none",
                     "one for tier \"contact\"; hostgen build puts it into the pack");
  }
  return {model.shape, model.shape_map, model.mount, model.contact_map};
}

}  // namespace

ShapeSettings::Tier chosen_tier(const Model& model, ShapeSettings::Tier tier) {
  using Tier = ShapeSettings::Tier;
  if (tier != Tier::kBest) return tier;
  return model.contact_map ? Tier::kContact : Tier::kNewton;
}

std::unique_ptr<ShapeTier> make_shape_tier(const ShapeParts& parts, const ShapeSettings& settings) {
  switch (settings.tier) {
    case ShapeSettings::Tier::kMeasures:
      return std::make_unique<MeasuresTier>(parts);
    case ShapeSettings::Tier::kMap:
      return std::make_unique<MapTier>(parts);
    case ShapeSettings::Tier::kContact:
      return std::make_unique<ContactTier>(parts);
    case ShapeSettings::Tier::kMapAndNewton:
    case ShapeSettings::Tier::kNewton:
    case ShapeSettings::Tier::kBest:  // of parts alone
      break;
  }
  return std::make_unique<NewtonTier>(parts, settings);
}

ShapeStage::ShapeStage(const Model& model, const ShapeSettings& settings)
    : ShapeStage(parts_of(model, settings.tier), chosen(model, settings)) {}

ShapeStage::ShapeStage(const ShapeParts& parts, const ShapeSettings& settings)
    : rest_mm_(parts.shape.rest_mm),
      front_nodes_(parts.shape.front_nodes),
      plates_(parts.shape, parts.mount),
      tier_(make_shape_tier(parts, settings)) {
  shape_.node_mm = tier_->node_mm();
}

const FingerShape& ShapeStage::solve(const PlatePoses& poses, const PoseVector& motion, bool is_explained) {
  shape_.iterations = 0;
  shape_.fallback = false;
  if (poses.quality == Quality::kInvalid) {
    tier_->reset();
    shape_.quality = Quality::kInvalid;
    return shape_;
  }
  if (!plates_.plausible(poses)) {
    shape_.fallback = true;
    shape_.quality = shape_.source == ShapeSource::kRest ? Quality::kInvalid : Quality::kFresh;
    return shape_;
  }
  tier_->solve(plate_motions(poses), motion, is_explained, shape_);
  shape_.quality = Quality::kFresh;
  shape_.node_mm = tier_->node_mm();
  if (!shape_.node_mm.empty()) {
    const ShapeMeasures measures = measure_shape<float>(rest_mm_, front_nodes_, shape_.node_mm);
    shape_.rms_mm = measures.rms_mm;
    shape_.front_rms_mm = measures.front_rms_mm;
    shape_.largest_mm = measures.largest_mm;
  }
  return shape_;
}

}  // namespace finsight
