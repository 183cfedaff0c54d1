// Touches of a scene to train on: what lies between computed states of loads that are nearly the same.
#pragma once

#include "hostgen/learn/touch_training.h"

namespace finsight::host {

/// A source for train_touch(). A touch lies between two of the states near one state: so little apart, plates, forces
/// and moments are those of both loads at once, each with its share. Touches of a frictionless push at one point come
/// from a StateInterpolant instead, which is exact at the states. `spec` must outlive it; `plan` is that of the states.
TouchSource touches_of_scene(const FingerSpec& spec, const DatasetPlan& plan);

}  // namespace finsight::host
