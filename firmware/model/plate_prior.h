// Completes plates that were not seen, by the pack's Gaussian over plate motions.
#pragma once

#include <array>

#include "firmware/model/model.h"

namespace finsight {

/// Replaces the numbers of unseen plates by their conditional mean given the seen ones; if no plate is seen, by the
/// prior's mean. Their previous values are not read. About 2 us, never allocates. The covariance must be positive
/// definite.
void complete_from_prior(const PlatePrior& prior, const std::array<bool, kPlates>& seen, PoseVector& numbers);

/// The same for poses: fills every plate whose `seen` is false and leaves `seen` and `quality` as they are.
void complete_from_prior(const PlatePrior& prior, PlatePoses& poses);

}  // namespace finsight
