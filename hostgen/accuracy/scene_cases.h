// What a finger may meet, one kind of touch at a time: the cases that area scene judges a pack by. None of their states
// is one that a pack is trained on.
#pragma once

#include <string>
#include <vector>

#include "firmware/shape/shape_measures.h"
#include "hostgen/fem/dataset.h"

namespace finsight::host {

/// States of one kind, and all that differs from the pack's finger at rest, upright and as its spec has it.
struct SceneCase {
  std::string name;
  std::vector<std::string> scenes = {};  ///< that contain it
  enum class Load { kPoint, kAlong, kAcross, kAgainst, kDisc, kLine, kTwo, kSide, kBack, kTip, kAny };
  Load load = Load::kPoint;  ///< kAny: drawn from the first of `scenes`, as for a training set
  double friction = 0;
  double diameter_mm = 0;
  double second_share = 0;  ///< of the force, at the second of two points
  double stiffness = 1;     ///< Young's modulus, relative
  double wall_mm = 0;       ///< added to every wall
  MeshSize mesh = MeshSize::kDefault;
  double marker_mm = 0, marker_rad = 0;  ///< how far markers stick from their place: standard deviations, by axis
  enum class Gravity { kNone, kKnown, kUnknown };
  Gravity gravity = Gravity::kNone;
  double turned_rad = 0, felt_g = 1;  ///< with gravity, between the zero and the touch: in any direction, from any pose
  enum class Motion { kTouch, kLoosePlate, kSwing };
  Motion motion = Motion::kTouch;  ///< what else moves the plates

  bool is_contained_in(const std::string& scene) const;
  /// Whether the plates move as the load moves them, and the markers show it.
  bool is_one_pose() const { return gravity == Gravity::kNone && motion == Motion::kTouch && marker_mm == 0; }
};

std::vector<SceneCase> scene_cases();

/// The finger of a case: its own mesh where its walls differ.
FingerSpec spec_of(const FingerSpec& spec, const SceneCase& scene_case);

/// A state of a case, how far it deforms the finger, and how the plates stand when nothing touches it.
struct CaseState {
  FemState state;
  ShapeMeasures shape;
  std::array<PlateMotion, kPlates> untouched, at_zero;
  Eigen::Vector3d felt_g = Eigen::Vector3d::Zero(), zero_g = felt_g;  ///< at the touch, and at the zero
};
/// States at `places` places, two forces each; those that are no equilibrium are left out. On all cores; the same
/// arguments give the same states.
std::vector<CaseState> solve_case(const FingerSpec& spec, const SceneCase& scene_case, int places);

}  // namespace finsight::host
