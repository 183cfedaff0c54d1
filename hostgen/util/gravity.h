// How heavy things are.
#pragma once

namespace finsight::host {

/// Standard gravity. It differs by 0.3 % between places, less than weights of a set do.
inline constexpr double kGravity_m_s2 = 9.80665;
inline double weight_n(double mass_g) { return kGravity_m_s2 * mass_g / 1000; }

}  // namespace finsight::host
