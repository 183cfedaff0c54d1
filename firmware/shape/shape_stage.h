// PlatePoses -> FingerShape, by one of the tiers.
#pragma once

#include <memory>

#include "firmware/shape/rigid_plates.h"
#include "firmware/shape/shape_tier.h"

namespace finsight {

/// The tier that runs: with kBest the one that is best with this pack.
ShapeSettings::Tier chosen_tier(const Model& model, ShapeSettings::Tier tier);

class ShapeStage {
 public:
  /// Throws InputError if the tier is kContact and the pack has no contact map.
  ShapeStage(const Model& model, const ShapeSettings& settings);
  /// Throws InputError if the parts do not fit each other.
  ShapeStage(const ShapeParts& parts, const ShapeSettings& settings);

  /// The shape for these plates; `motion` is pose_vector(poses), `is_explained` whether a touch of the pack's scene may
  /// have moved them so (tier contact learnt from such touches only). Never throws, never allocates. The shape is
  /// finite and has no inverted element, whatever the poses are. `fallback` marks a shape that is not the tier's own:
  /// after a failed solve that of the map, or if that one has an inverted element, part of the way to it; and a shape
  /// that strains the finger more than any touch can. Poses that are not finite or absurd keep the last shape, marked
  /// too; invalid poses keep it and start over with the next valid ones. `quality` is that of this answer alone:
  /// invalid for invalid poses and before the first shape, else fresh. The result stays valid until the next call.
  const FingerShape& solve(const PlatePoses& poses, const PoseVector& motion, bool is_explained = true);
  const FingerShape& solve(const PlatePoses& poses) { return solve(poses, pose_vector(poses)); }
  /// Forgets the last shape: the next solve starts from the shape map.
  void reset() { tier_->reset(); }

 private:
  std::span<const float> rest_mm_;
  std::span<const std::int32_t> front_nodes_;
  RigidPlates plates_;
  std::unique_ptr<ShapeTier> tier_;
  FingerShape shape_;
};

}  // namespace finsight
