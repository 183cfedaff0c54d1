// How much further a force that lasts bends a finger, from weights that hung for long.
#pragma once

#include <optional>
#include <vector>

namespace finsight::host {

/// What a device read of one weight, by the time since it was hung up.
struct ForceSeries {
  std::vector<double> after_s, force_n;
};

struct Creep {
  double share = 0;    ///< by which it bends the finger further in the end
  double after_s = 1;  ///< time constant
  double sigma = 0;    ///< standard deviation of the share
};

/// Least squares: one creep for all holds, of any force each. Nothing where there is no hold.
std::optional<Creep> fit_creep(const std::vector<ForceSeries>& holds);

/// Mean of what would have been read had the finger not crept.
double mean_without_creep(const ForceSeries& hold, const std::optional<Creep>& creep);

}  // namespace finsight::host
