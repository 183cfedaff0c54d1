// Touches of a scene to train on: computed states, each changed a little as the scene allows.
#pragma once

#include "hostgen/fem/linear_response.h"
#include "hostgen/learn/touch_training.h"

namespace finsight::host {

/// A source for train_touch(). Around every state the contact is moved, turned and pressed more or less; what that
/// changes in the plates is taken from the linear response and a ResponseSurface of the same states, so that the
/// surface's own error counts only as far as the change goes. Touches of a frictionless push at one point come from a
/// StateInterpolant instead, which is exact at the states. `finger` and `response` must outlive it; `plan` is that of
/// the states.
TouchSource touches_of_scene(const PushedFinger& finger, const LinearResponse& response, const DatasetPlan& plan);

}  // namespace finsight::host
