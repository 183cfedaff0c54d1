// The plan of the factorisation: the solver follows it blindly through memory, so everything in it is checked here.
#include <algorithm>
#include <functional>
#include <utility>

#include "firmware/model/checks.h"

namespace finsight {

namespace {

using Indices = std::span<const std::int32_t>;
using Block = std::pair<std::int32_t, std::int32_t>;  // column, row; both elimination positions

// Total size of all frontal matrices (256 MiB of floats), about ten times that of a mesh of 15,000 tets.
constexpr std::int64_t kMaxFrontScalars = std::int64_t{1} << 26;

Indices slice(Indices items, Indices starts, std::size_t i) {
  return items.subspan(static_cast<std::size_t>(starts[i]), static_cast<std::size_t>(starts[i + 1] - starts[i]));
}

/// `starts` must rise from 0 to `total` in steps of at least `min_step`.
void check_starts(const SafetensorsFile& file, const char* name, Indices starts, std::size_t total, int min_step) {
  const auto step_is_wrong = [&](std::int64_t a, std::int64_t b) { return b - a < min_step; };
  const auto wrong = std::adjacent_find(starts.begin(), starts.end(), step_is_wrong);
  if (wrong != starts.end()) {
    file.refuse(name, std::to_string(wrong[0]) + " before " + std::to_string(wrong[1]), "ascending indices");
  }
  if (starts.front() != 0 || static_cast<std::size_t>(starts.back()) != total) {
    file.refuse(name, std::to_string(starts.front()) + " to " + std::to_string(starts.back()),
                "0 to " + std::to_string(total));
  }
}

/// The elimination position of every free node.
std::vector<std::int32_t> check_order(const SafetensorsFile& file, const CholeskyPlan& plan) {
  std::vector<std::int32_t> position(plan.order.size(), -1);
  for (std::size_t i = 0; i < plan.order.size(); ++i) {
    const std::int32_t node = plan.order[i];
    if (node < 0 || node >= plan.blocks || position[static_cast<std::size_t>(node)] >= 0) {
      file.refuse(tensor::kOrder, std::to_string(node) + " at position " + std::to_string(i),
                  "each of 0 to " + std::to_string(plan.blocks - 1) + " once");
    }
    position[static_cast<std::size_t>(node)] = static_cast<std::int32_t>(i);
  }
  return position;
}

/// The lower blocks that the tets couple, by column, then by row.
std::vector<Block> couplings(const ShapeModel& shape, const std::vector<std::int32_t>& position) {
  std::vector<Block> blocks;
  for (std::size_t t = 0; t < static_cast<std::size_t>(shape.tets); ++t) {
    for (const std::int32_t a : shape.tet_nodes.subspan(4 * t, 4)) {
      for (const std::int32_t b : shape.tet_nodes.subspan(4 * t, 4)) {
        const std::int32_t free_a = shape.free_index[static_cast<std::size_t>(a)];
        const std::int32_t free_b = shape.free_index[static_cast<std::size_t>(b)];
        if (free_a < 0 || free_b < 0) continue;
        const Block block(position[static_cast<std::size_t>(free_a)], position[static_cast<std::size_t>(free_b)]);
        if (block.first <= block.second) blocks.push_back(block);
      }
    }
  }
  std::sort(blocks.begin(), blocks.end());
  blocks.erase(std::unique(blocks.begin(), blocks.end()), blocks.end());
  return blocks;
}

/// Compares the whole pattern with the couplings, which also checks its order, its diagonal and its range.
void check_pattern(const SafetensorsFile& file, const ShapeModel& shape, const std::vector<std::int32_t>& position) {
  const CholeskyPlan& plan = shape.cholesky;
  check_starts(file, tensor::kPatternStart, plan.pattern_start, plan.pattern_row.size(), 1);
  const std::vector<Block> expected = couplings(shape, position);
  std::vector<Block> found;
  for (std::size_t j = 0; j < static_cast<std::size_t>(plan.blocks); ++j) {
    for (const std::int32_t row : slice(plan.pattern_row, plan.pattern_start, j)) {
      found.emplace_back(static_cast<std::int32_t>(j), row);
    }
  }
  const auto [e, f] = std::mismatch(expected.begin(), expected.end(), found.begin(), found.end());
  if (e == expected.end() && f == found.end()) return;
  const auto text = [](bool none, Block block) {
    if (none) return std::string("no further block");
    return "row " + std::to_string(block.second) + " in column " + std::to_string(block.first);
  };
  file.refuse(tensor::kPatternRow, text(f == found.end(), f == found.end() ? Block() : *f),
              text(e == expected.end(), e == expected.end() ? Block() : *e) + ", as the tets couple the nodes");
}

/// Rows of each supernode: ascending, below its columns, inside the matrix; and fronts small enough for a board's
/// memory.
void check_rows(const SafetensorsFile& file, const CholeskyPlan& plan) {
  std::int64_t scalars = 0;
  for (std::size_t s = 0; s + 1 < plan.supernode_start.size(); ++s) {
    const Indices rows = slice(plan.rows, plan.rows_start, s);
    const std::int32_t first = plan.supernode_start[s], end = plan.supernode_start[s + 1];
    const bool ascending = std::adjacent_find(rows.begin(), rows.end(), std::greater_equal<>()) == rows.end();
    if (!ascending || (!rows.empty() && (rows.front() < end || rows.back() >= plan.blocks))) {
      file.refuse(tensor::kRows, "rows out of order or range at supernode " + std::to_string(s),
                  "ascending positions from " + std::to_string(end) + " to " + std::to_string(plan.blocks - 1));
    }
    const std::int64_t front = 3 * (end - first + static_cast<std::int64_t>(rows.size()));
    scalars += front * front;
    if (scalars > kMaxFrontScalars) {
      file.refuse(tensor::kRows, "a factor of over " + std::to_string(kMaxFrontScalars) + " numbers",
                  "a smaller factor");
    }
  }
}

/// The factor's structure is closed: it has a place for every coupling of a column and for all fill-in.
void check_closed(const SafetensorsFile& file, const CholeskyPlan& plan) {
  std::vector<std::size_t> supernode_of(static_cast<std::size_t>(plan.blocks));
  for (std::size_t s = 0; s + 1 < plan.supernode_start.size(); ++s) {
    std::fill(supernode_of.begin() + plan.supernode_start[s], supernode_of.begin() + plan.supernode_start[s + 1], s);
  }
  const auto holds = [&](std::size_t s, Indices ascending) {
    const Indices rows = slice(plan.rows, plan.rows_start, s);
    const auto below = std::lower_bound(ascending.begin(), ascending.end(), plan.supernode_start[s + 1]);
    return std::includes(rows.begin(), rows.end(), below, ascending.end());
  };
  const auto refuse = [&](std::size_t s) {
    file.refuse(tensor::kRows, "rows missing at supernode " + std::to_string(s),
                "all rows that its columns and its children fill");
  };
  for (std::size_t j = 0; j < supernode_of.size(); ++j) {
    if (!holds(supernode_of[j], slice(plan.pattern_row, plan.pattern_start, j))) refuse(supernode_of[j]);
  }
  for (std::size_t s = 0; s + 1 < plan.supernode_start.size(); ++s) {
    const Indices rows = slice(plan.rows, plan.rows_start, s);
    if (rows.empty()) continue;
    const std::size_t parent = supernode_of[static_cast<std::size_t>(rows.front())];
    if (!holds(parent, rows)) refuse(parent);
  }
}

}  // namespace

void check_plan(const SafetensorsFile& file, const ShapeModel& shape) {
  const CholeskyPlan& plan = shape.cholesky;
  check_pattern(file, shape, check_order(file, plan));
  check_starts(file, tensor::kSupernodeStart, plan.supernode_start, static_cast<std::size_t>(plan.blocks), 1);
  check_starts(file, tensor::kRowsStart, plan.rows_start, plan.rows.size(), 0);
  check_rows(file, plan);
  check_closed(file, plan);
}

}  // namespace finsight
