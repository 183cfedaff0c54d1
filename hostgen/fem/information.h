// What noisy plate motions can tell of a contact at best: the Fisher information of its numbers.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "hostgen/finger/spec.h"

namespace finsight::host {

/// The smallest standard deviations that any unbiased estimate can have (Cramer and Rao), or, where a number is hardly
/// told, that of its own spread in the scene: the median over contacts that move a plate by 4 mm or more.
struct InformationLimit {
  std::string name;  ///< what is not known beforehand
  std::size_t states = 0;
  std::vector<std::pair<std::string, double>> deviations = {};  ///< by number, with its unit in the name
};

/// For one frictionless push, for a patch with friction, for the same where gravity may have any direction, for two
/// pushes without friction and for two with: at `places` places each. The derivatives are differences of finite-element
/// equilibria, of gravity the tangent.
std::vector<InformationLimit> information_limits(const FingerSpec& spec, int places);

}  // namespace finsight::host
