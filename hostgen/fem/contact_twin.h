// The single contact of a scene that moves the plates most as another load does. Where it moves them alike within the
// noise, no test of the plates can tell the two apart.
#pragma once

#include "hostgen/fem/statics.h"

namespace finsight::host {

struct ContactTwin {
  double distance = 0;  ///< between the two motions of the plates, in standard deviations of the spec's noise
  FemState state = {};  ///< of the contact
};

/// Searches over place, normal force, friction and radius of an even pressure, within the scene's ranges and up to 1.25
/// times the spec's largest force: damped Gauss-Newton on finite-element equilibria, from a push of the same force at
/// the centre of pressure of `of`. What it finds may not be the nearest contact of all, so `distance` is an upper
/// bound; it is infinite if there is no equilibrium to start from. Throws Interrupted.
ContactTwin closest_contact(FingerStatics& finger, const FingerSpec& spec, const Scene& scene, const FemState& of);

/// The largest share of the frames of one motion that a test can refuse which refuses no more than one in a thousand
/// frames of another, `distance` standard deviations of the noise away (Neyman and Pearson 1933, Gaussian noise).
double largest_share_refused(double distance);

}  // namespace finsight::host
