// One way from plate poses to the finger's shape, chosen at the start ("model only what a scene needs"). Each tier has
// a file of its own: measures_tier, map_tier, contact_tier, newton_tier.
#pragma once

#include <memory>
#include <span>
#include <utility>

#include "firmware/model/model.h"
#include "firmware/shape/rigid_plates.h"

namespace finsight {

/// Cost of the newton tiers on one x86-64 core at 3.3k tets: about 1.3 ms per factorisation, 0.5 ms per chord step.
struct ShapeSettings {
  /// kMeasures: the measures of the shape map's shape, without the shape: all that the registers need, unchecked.
  /// kMap: the shape map alone. kContact: the contact map's shape, which has the dimple under the touch; the shape
  /// map's where the plates are further than the contact map's training had them, or its shape is unusable.
  /// kMapAndNewton: Newton steps from the map's shape, every frame by itself. kNewton: Newton steps from the last
  /// frame's shape; see NewtonTier. kBest: kContact if the pack has a contact map, else kNewton.
  enum class Tier { kMeasures, kMap, kContact, kMapAndNewton, kNewton, kBest } tier = Tier::kNewton;
  int factorisations = 1;
  int chord_steps = 1;  ///< further steps per factorisation that reuse its factor
};

/// The tiers as board files call them.
inline constexpr std::pair<const char*, ShapeSettings::Tier> kShapeTiers[] = {
    {"measures", ShapeSettings::Tier::kMeasures}, {"map", ShapeSettings::Tier::kMap},
    {"contact", ShapeSettings::Tier::kContact},   {"map+newton", ShapeSettings::Tier::kMapAndNewton},
    {"newton", ShapeSettings::Tier::kNewton},     {"best", ShapeSettings::Tier::kBest},
};

/// Whether a tier takes Newton steps, so that the schedule of ShapeSettings concerns it.
constexpr bool takes_newton_steps(ShapeSettings::Tier tier) {
  return tier == ShapeSettings::Tier::kMapAndNewton || tier == ShapeSettings::Tier::kNewton;
}

/// The parts of a model that the tiers work on. They view memory of their owner, which must outlive the tier.
struct ShapeParts {
  ShapeModel shape;
  ShapeMapModel map;
  MountModel mount;
  ShapeMapModel contact_map = {};  ///< for tier kContact only
};

class ShapeTier {
 public:
  virtual ~ShapeTier() = default;

  /// The shape for plausible plates; `motion` is the same as numbers, `is_explained` as for ShapeStage::solve(). Sets
  /// source, iterations and fallback, and the measures if it has no nodes. Never throws, never allocates.
  virtual void solve(const PlateMotions& plates, const PoseVector& motion, bool is_explained, FingerShape& shape) = 0;
  /// [3 * nodes] of the last shape, at first those at rest; empty in a tier that has no shape, only its measures.
  virtual std::span<const float> node_mm() const = 0;
  /// Forgets the last shape, which says nothing about the next one.
  virtual void reset() {}
};

/// Throws InputError if the parts do not fit each other.
std::unique_ptr<ShapeTier> make_shape_tier(const ShapeParts& parts, const ShapeSettings& settings);

}  // namespace finsight
