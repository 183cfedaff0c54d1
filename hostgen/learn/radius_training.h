// Fits the network that evens out how many errors the published radius holds.
#pragma once

#include <vector>

#include "hostgen/learn/touch_score.h"

namespace finsight::host {

/// Fits TouchModel's radius network to trials of touches that were not learnt (TouchTrial::scene from kFirstKept on),
/// which were published with radii that have no such network yet. Trials below the threshold or unexplained do not
/// count.
///
/// A radius that holds 68 % of all errors holds more of some kinds of touch and fewer of others, since the plates
/// hardly tell which it is. But where a touch lies and what friction it seems to have makes some kinds likelier, and
/// that is enough to choose the radius so that every kind has nearly its 68 %. Loss: for each kind of the scene
/// (draw_kind()), and for all of them where gravity is not known, the squared differences between the shares of errors
/// inside one and two radii and the wanted ones, and the square of the share beyond three; for each other scene the
/// share beyond three radii, since what is taken for a touch should at least have a radius that holds it. Steps from
/// inside to outside are smoothed. Without trials of the scene nothing changes. Throws Interrupted on Ctrl-C. Same
/// arguments, same numbers.
void fit_radius_network(const std::vector<TouchTrial>& trials, double threshold_mm, TouchModelData& model);

}  // namespace finsight::host
