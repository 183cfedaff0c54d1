// What the pack's Gaussian over plate motions says about the plates that were not seen.
#pragma once

#include <array>

#include "firmware/model/model.h"

namespace finsight {

/// Replaces the numbers of the plates that are not seen by their conditional mean given the seen ones; with no plate
/// seen that is the prior's mean. Whatever stood in the unseen places is not read. About 2 us, never allocates. The
/// covariance must be positive definite.
void complete_from_prior(const PlatePrior& prior, const std::array<bool, kPlates>& seen, PoseVector& numbers);

/// The same for poses: fills every plate whose `seen` is false; `seen` and `quality` stay.
void complete_from_prior(const PlatePrior& prior, PlatePoses& poses);

}  // namespace finsight
