// The contacts of a scene: drawn at random, or as the paths of a training set.
#pragma once

#include <vector>

#include "hostgen/fem/contact.h"
#include "hostgen/util/random.h"

namespace finsight::host {

/// One touch of the scene, its first contact at `place_mm` of the face (lines across the whole face lie in its middle).
/// Friction is drawn evenly from all directions and sizes, and so is how far the force follows the face: an object
/// that is held keeps its direction to the base, one that lies on the face turns with it.
std::vector<FaceContact> draw_contacts(const FingerSpec& spec, const Scene& scene, const Eigen::Vector2d& place_mm,
                                       Random& random);

/// Touches of a scene by what the plates hardly tell of them: a point; a point with a third, two thirds and all of the
/// scene's friction, each away from the base, towards it and across; round patches of up to a third, two thirds and all
/// of the scene's size; lines over the whole width, straight across and at an angle; and any touch of the scene. Where
/// a scene has no friction, no patches or no lines, those are points. In a scene with friction those without it press
/// normally to the face as it turns.
inline constexpr int kKindsOfTouch = 16, kAnyTouch = 15;
/// The same as draw_contacts(), the first contact of this kind, from 0.
std::vector<FaceContact> draw_kind(const FingerSpec& spec, const Scene& scene, int kind,
                                   const Eigen::Vector2d& place_mm, Random& random);

/// A place of the touched part of the face, about `distance_mm` away.
Eigen::Vector2d place_near(const FingerSpec& spec, const Eigen::Vector2d& place_mm, double distance_mm, Random& random);

/// A contact of the scene that is like `contact`: moved by about `distance_mm`, its friction and patch changed to
/// match; friction up to a quarter beyond the scene's.
FaceContact vary(const FingerSpec& spec, const Scene& scene, const FaceContact& contact, double distance_mm,
                 Random& random);

}  // namespace finsight::host
