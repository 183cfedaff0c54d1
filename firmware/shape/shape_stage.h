// PlatePoses -> FingerShape: shape map, then a fixed number of Newton steps.
#pragma once

#include <memory>

#include "firmware/model/model.h"

namespace finsight {

/// The fixed schedule of a frame. Cost on one x86-64 core at 3.3k tets: about 1.3 ms per factorisation, 0.5 ms per
/// chord.
struct ShapeSettings {
  /// kMeasures: what the shape map's shape measures, without the shape: all that registers need, and no check of it.
  /// kMap: the shape map alone. kContact: the contact map's shape, which has the dimple under the touch; the shape
  /// map's where the plates are further than the contact map's training had them, or its shape is none. kMapAndNewton:
  /// Newton steps from the map's shape, every frame by itself. kNewton: Newton steps from the last frame's shape; from
  /// the map's after a gap, after a jump of the plates, and where the map's shape costs clearly less energy, or after a
  /// rough frame a solve from rest does, so that a wrong minimum does not last.
  enum class Tier { kMeasures, kMap, kContact, kMapAndNewton, kNewton } tier = Tier::kNewton;
  int factorisations = 1;
  int chord_steps = 1;  ///< further steps per factorisation that reuse its factor
};

class ShapeStage {
 public:
  /// Throws InputError if the tier is kContact and the pack has no contact map.
  ShapeStage(const Model& model, const ShapeSettings& settings);
  /// The arrays that the parts view must live as long as the stage. Throws InputError if they do not fit each other.
  /// The contact map is for tier kContact only.
  ShapeStage(const ShapeModel& shape, const ShapeMapModel& map, const MountModel& mount, const ShapeSettings& settings,
             const ShapeMapModel& contact_map = {});
  ~ShapeStage();
  /// The shape for these plates, warm-started from the last one. Never throws, never allocates. The shape is finite and
  /// has no inverted element, whatever the poses are. `fallback` marks a shape that is not the solve's: after a failed
  /// solve that of the map, or if that one has an inverted element, part of the way to it; and a shape that strains
  /// the finger more than any touch can. Poses that are not finite or absurd keep the last shape, marked too. At most 2
  /// NewtonSolver::kMaxFactorisations factorisations. The result stays valid until the next call; it has no nodes in
  /// tier kMeasures. Quality: fresh if all plates were seen in this frame and the solve worked; invalid if the poses
  /// are, or before the first shape; else held.
  const FingerShape& solve(const PlatePoses& poses);
  /// Forgets the last shape (start, or after a gap): the next solve starts from the shape map.
  void reset();

 private:
  struct Workspace;
  std::unique_ptr<Workspace> work_;
};

}  // namespace finsight
