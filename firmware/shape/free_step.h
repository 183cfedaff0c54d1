// From forces to a step of the free nodes: what every Newton step does once its Hessian is factored.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <span>

#include "firmware/shape/cholesky.h"

namespace finsight {

template <class S>
struct FreeStep {
  double slope = 0;  ///< of the energy along the step: gradient^T step
  S largest = 0;     ///< coordinate change of any free node
};

/// Solves H step = -gradient for the free nodes, with a new factor of the values or the one that is there; nothing if a
/// pivot fails. free_offsets: 3 * node of each; solution: [3 * free nodes], for the solve's own use; gradient and step:
/// [3 * nodes], of which the other nodes stay as they are.
template <class S>
std::optional<FreeStep<S>> solve_free_step(Cholesky<S>& cholesky, bool new_factor,
                                           std::span<const std::int32_t> free_offsets, std::span<const S> gradient,
                                           std::span<S> solution, std::span<S> step) {
  for (std::size_t i = 0; i < free_offsets.size(); ++i)
    for (int d = 0; d < 3; ++d) solution[3 * i + d] = -gradient[free_offsets[i] + d];
  if (!new_factor) {
    cholesky.solve(solution);
  } else if (!cholesky.factor_and_solve(solution)) {
    return std::nullopt;
  }
  FreeStep<S> result;
  for (std::size_t i = 0; i < free_offsets.size(); ++i)
    for (int d = 0; d < 3; ++d) {
      const S dx = solution[3 * i + d];
      step[free_offsets[i] + d] = dx;
      result.largest = std::max(result.largest, std::abs(dx));
      result.slope += static_cast<double>(gradient[free_offsets[i] + d]) * static_cast<double>(dx);
    }
  return result;
}

}  // namespace finsight
