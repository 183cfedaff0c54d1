// Symbolic analysis of a block-sparse symmetric matrix: elimination order, supernodes, rows of the factor.
#pragma once

#include <functional>
#include <vector>

#include "firmware/model/model.h"

namespace finsight::host {

/// Owns what a CholeskyPlan views.
struct CholeskyPlanData {
  int blocks = 0;
  std::vector<std::int32_t> order, pattern_start, pattern_row, supernode_start, rows_start, rows;
  CholeskyPlan view() const;
};

/// What nested dissection costs depends on its seed by up to a tenth: so many are tried for a board, which solves with
/// its plan for years.
inline constexpr int kDissections = 8;
/// Of each part so many cuts are tried and the one with the smallest separator is kept: 3 % fewer operations at 16,000
/// tetrahedra than with one.
inline constexpr int kCuts = 4;

/// Is asked between the parts of long work, and ends it by throwing.
using CheckIn = std::function<void()>;

/// `neighbours[i]`: the blocks coupled with block i, ascending, without i itself; symmetric. The cheapest of minimum
/// degree (Eigen's AMD) and `dissections` nested dissections (METIS) with `cuts` tried of each part, postordered,
/// supernodes relaxed where merging pays. Of more than 50,000 blocks minimum degree is not tried: in solids it is far
/// from the cheapest, and its factor's pattern alone would take gigabytes. Without a `check_in` Ctrl-C throws
/// Interrupted.
CholeskyPlanData plan_cholesky(const std::vector<std::vector<int>>& neighbours, int dissections = kDissections,
                               int cuts = kCuts, const CheckIn& check_in = {});

}  // namespace finsight::host
