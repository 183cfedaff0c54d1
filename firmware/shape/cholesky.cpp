#include "firmware/shape/cholesky.h"

#include <algorithm>
#include <cassert>
#include <string>
#include <utility>

#include "firmware/input_error.h"
#include "firmware/shape/cholesky_kernels.h"
#include "firmware/shape/flush_denormals.h"

// Legend: P panel of a front, D its diagonal block, L21 the rows below it, U = -L21 L21^T + children its update.

namespace finsight {

namespace {

[[noreturn]] void refuse(const std::string& field, long long found, const std::string& expected) {
  throw InputError("Cholesky plan", field, std::to_string(found), expected);
}

// Asks for memory that will be needed soon, while there is still something else to compute. More than this would push
// out of the second-level cache what is being worked on.
constexpr std::size_t kPrefetchedBytes = 128 << 10, kCacheLine = 64;

template <bool kForWriting, class T>
void prefetch(const T* from, std::size_t count) {
  const char* bytes = reinterpret_cast<const char*>(from);
  const std::size_t size = std::min(count * sizeof(T), kPrefetchedBytes);
  for (std::size_t k = 0; k < size; k += kCacheLine) __builtin_prefetch(bytes + k, kForWriting);
}

// Starts of ranges: first 0, ascending, last the number of what they point into.
void check_starts(std::span<const std::int32_t> starts, std::size_t total, bool may_be_empty, const std::string& name) {
  if (starts.empty() || starts.front() != 0) refuse(name, starts.empty() ? -1 : starts.front(), "0 first");
  for (std::size_t k = 1; k < starts.size(); ++k)
    if (starts[k] < starts[k - 1] + (may_be_empty ? 0 : 1)) refuse(name, starts[k], "ascending numbers");
  if (static_cast<std::size_t>(starts.back()) != total) refuse(name, starts.back(), std::to_string(total) + " last");
}

void check_plan(const CholeskyPlan& plan) {
  const auto n = static_cast<std::size_t>(std::max(plan.blocks, 0));
  if (plan.blocks < 1 || plan.order.size() != n) refuse("order", plan.blocks, "one entry per block, at least one");
  std::vector<char> seen(n, 0);
  for (const int block : plan.order) {
    if (block < 0 || block >= plan.blocks || seen[block]) refuse("order", block, "every block once");
    seen[block] = 1;
  }
  if (plan.pattern_start.size() != n + 1) refuse("pattern_start", plan.blocks, "one entry per block and one more");
  check_starts(plan.pattern_start, plan.pattern_row.size(), false, "pattern_start");
  for (int j = 0; j < plan.blocks; ++j) {
    if (plan.pattern_row[plan.pattern_start[j]] != j) refuse("pattern_row", j, "the diagonal first in every column");
    for (int e = plan.pattern_start[j] + 1; e < plan.pattern_start[j + 1]; ++e)
      if (plan.pattern_row[e] <= plan.pattern_row[e - 1] || plan.pattern_row[e] >= plan.blocks)
        refuse("pattern_row", plan.pattern_row[e], "ascending rows below the number of blocks");
  }
  check_starts(plan.supernode_start, n, false, "supernode_start");
  if (plan.rows_start.size() != plan.supernode_start.size())
    refuse("rows_start", static_cast<long long>(plan.rows_start.size()), "one entry per supernode and one more");
  check_starts(plan.rows_start, plan.rows.size(), true, "rows_start");
  for (std::size_t s = 0; s + 1 < plan.supernode_start.size(); ++s)
    for (int k = plan.rows_start[s], last = plan.supernode_start[s + 1] - 1; k < plan.rows_start[s + 1]; ++k) {
      if (plan.rows[k] <= last || plan.rows[k] >= plan.blocks)
        refuse("rows", plan.rows[k], "ascending rows below the supernode's diagonal block");
      last = plan.rows[k];
    }
}

}  // namespace

template <class S>
Cholesky<S>::Cholesky(const CholeskyPlan& plan) {
  check_plan(plan);
  order_.assign(plan.order.begin(), plan.order.end());
  position_.resize(order_.size());
  for (std::size_t k = 0; k < order_.size(); ++k) position_[order_[k]] = static_cast<std::int32_t>(k);
  pattern_start_.assign(plan.pattern_start.begin(), plan.pattern_start.end());
  pattern_row_.assign(plan.pattern_row.begin(), plan.pattern_row.end());
  row_positions_.assign(plan.rows.begin(), plan.rows.end());
  make_fronts(plan);
  connect_fronts(plan);
  place_updates();
  place_entries(plan);
  values_.assign(9 * pattern_row_.size(), S(0));
  solution_.assign(3 * order_.size(), S(0));
}

template <class S>
void Cholesky<S>::make_fronts(const CholeskyPlan& plan) {
  std::size_t panel_size = 0, longest = 0;
  fronts_.resize(plan.supernode_start.size() - 1);
  for (std::size_t s = 0; s < fronts_.size(); ++s) {
    Front& front = fronts_[s];
    const int begin = plan.supernode_start[s], end = plan.supernode_start[s + 1];
    front.first_column = 3 * begin;
    front.columns = 3 * (end - begin);
    front.rows = 3 * (plan.rows_start[s + 1] - plan.rows_start[s]);
    front.diagonal_rows = dense::padded<S>(front.columns);
    front.update_stride = dense::padded<S>(front.rows);
    front.stride = front.diagonal_rows + front.update_stride;
    front.panel = panel_size;
    panel_size += static_cast<std::size_t>(front.stride) * front.columns;
    front.entries_begin = plan.pattern_start[begin];
    front.entries_end = plan.pattern_start[end];
    front.rows_begin = plan.rows_start[s];
    longest = std::max<std::size_t>(longest, front.stride);
  }
  constexpr std::size_t kLargestFactor = std::size_t{1} << 28;
  if (panel_size > kLargestFactor)
    refuse("supernode_start", static_cast<long long>(panel_size), "a factor of at most 2^28 numbers");
  panels_.resize(panel_size / dense::kWidth<S> + 1);  // one more for dense::add_block()
  front_vector_.resize(longest / dense::kWidth<S>);
}

// Row of a front's panel that holds an elimination position (its first scalar); -1 if the front has no such row.
template <class S>
int Cholesky<S>::front_row(const CholeskyPlan& plan, std::size_t front, int position) const {
  const Front& f = fronts_[front];
  if (3 * position < f.first_column) return -1;
  if (3 * position < f.first_column + f.columns) return 3 * position - f.first_column;
  const auto begin = plan.rows.begin() + plan.rows_start[front], end = plan.rows.begin() + plan.rows_start[front + 1];
  const auto found = std::lower_bound(begin, end, position);
  return found == end || *found != position ? -1 : f.diagonal_rows + 3 * static_cast<int>(found - begin);
}

// The update of a front goes to the front that eliminates its first row: its parent.
template <class S>
void Cholesky<S>::connect_fronts(const CholeskyPlan& plan) {
  std::vector<std::vector<std::size_t>> children(fronts_.size());
  for (std::size_t s = 0; s < fronts_.size(); ++s) {
    Front& front = fronts_[s];
    front.segments_begin = front.segments_split = front.segments_end = segments_.size();
    if (front.rows == 0) continue;
    const auto rows = plan.rows.subspan(plan.rows_start[s], front.rows / 3);
    const auto owner = std::upper_bound(plan.supernode_start.begin(), plan.supernode_start.end(), rows.front());
    const std::size_t p = static_cast<std::size_t>(owner - plan.supernode_start.begin()) - 1;
    children[p].push_back(s);
    bool was_below = false;
    int expected = -1;  // the destination that would continue the present segment
    for (std::size_t k = 0; k < rows.size(); ++k) {
      const int destination = front_row(plan, p, rows[k]);
      if (destination < 0) refuse("rows", rows[k], "a row of the parent of supernode " + std::to_string(s));
      const bool below = destination >= fronts_[p].diagonal_rows;
      if (destination == expected && below == was_below) {
        segments_.back().length += 3;
      } else {
        segments_.push_back({3 * static_cast<int>(k), destination, 3});
      }
      if (!below) front.segments_split = segments_.size();
      expected = destination + 3;
      was_below = below;
    }
    front.segments_end = segments_.size();
  }
  for (std::size_t s = 0; s < fronts_.size(); ++s) {
    fronts_[s].children_begin = children_.size();
    children_.insert(children_.end(), children[s].begin(), children[s].end());
    fronts_[s].children_end = children_.size();
  }
}

// An update lives from its front's factorisation until its parent has taken it in. Its place is found here once: the
// first gap between the updates that live at that time.
template <class S>
void Cholesky<S>::place_updates() {
  std::vector<std::pair<std::size_t, std::size_t>> live;  // begin, end; ascending
  std::size_t total = 0;
  for (Front& front : fronts_) {
    const std::size_t size = static_cast<std::size_t>(front.update_stride) * front.rows;
    if (size > 0) {
      auto next = live.begin();
      for (; next != live.end() && next->first - front.update < size; ++next) front.update = next->second;
      live.insert(next, {front.update, front.update + size});
      total = std::max(total, front.update + size);
    }
    for (std::size_t c = front.children_begin; c < front.children_end; ++c)
      std::erase_if(live, [&](const auto& range) { return range.first == fronts_[children_[c]].update; });
  }
  updates_.resize(total / dense::kWidth<S> + 1);  // one more for dense::add_block()
}

template <class S>
void Cholesky<S>::place_entries(const CholeskyPlan& plan) {
  entry_places_.resize(plan.pattern_row.size());
  for (std::size_t s = 0; s < fronts_.size(); ++s)
    for (int j = plan.supernode_start[s]; j < plan.supernode_start[s + 1]; ++j)
      for (int e = plan.pattern_start[j]; e < plan.pattern_start[j + 1]; ++e) {
        const int row = front_row(plan, s, plan.pattern_row[e]);
        if (row < 0) refuse("pattern_row", plan.pattern_row[e], "a row of supernode " + std::to_string(s));
        entry_places_[e] = row + fronts_[s].stride * (3 * j - fronts_[s].first_column);
      }
}

template <class S>
typename Cholesky<S>::BlockPlace Cholesky<S>::place(int row, int column) const {
  const int i = std::max(position_.at(row), position_.at(column)), j = std::min(position_[row], position_[column]);
  const auto begin = pattern_row_.begin() + pattern_start_[j], end = pattern_row_.begin() + pattern_start_[j + 1];
  const auto found = std::lower_bound(begin, end, i);
  if (found == end || *found != i)
    refuse("pattern_row", i, "an entry that couples blocks " + std::to_string(row) + " and " + std::to_string(column));
  return {static_cast<std::size_t>(found - pattern_row_.begin()), position_[row] < position_[column]};
}

template <class S>
double Cholesky<S>::factor_operations() const {
  double operations = 0;
  for (const Front& front : fronts_)
    for (int c = 0; c < front.columns; ++c) {
      const double below = front.columns - c + front.rows;
      operations += below * below / 2;
    }
  return operations;
}

template <class S>
bool Cholesky<S>::factor() {
  return factor_fronts(false);
}

template <class S>
bool Cholesky<S>::factor_and_solve(std::span<S> b) {
  assert(b.size() == solution_.size());
  permute_in(b);
  if (!factor_fronts(true)) return false;
  const FlushDenormals flush;
  for (std::size_t s = fronts_.size(); s-- > 0;) solve_backward(fronts_[s]);
  permute_out(b);
  return true;
}

template <class S>
bool Cholesky<S>::factor_fronts(bool and_solve_forward) {
  const FlushDenormals flush;
  usable_ = false;
  for (const Front& front : fronts_) {
    if (stop_ && stop_->load(std::memory_order_relaxed)) return false;
    fill_panel(front);
    for (std::size_t c = front.children_begin; c < front.children_end; ++c) {
      const Front& child = fronts_[children_[c]];
      add_child(child, child.segments_begin, child.segments_split, panel(front), front.stride, 0);
    }
    if (!factor_panel(front)) return false;
    if (and_solve_forward) solve_forward(front);
    if (&front != &fronts_.back()) prefetch_for_factor((&front)[1]);
    make_update(front);
    for (std::size_t c = front.children_begin; c < front.children_end; ++c) {
      const Front& child = fronts_[children_[c]];
      add_child(child, child.segments_split, child.segments_end, update(front), front.update_stride,
                front.diagonal_rows);
    }
  }
  return usable_ = true;
}

template <class S>
void Cholesky<S>::prefetch_for_factor(const Front& front) const {
  const std::size_t entries = front.entries_end - front.entries_begin;
  prefetch<true>(panel(front), static_cast<std::size_t>(front.stride) * front.columns);
  prefetch<false>(values_.data() + 9 * front.entries_begin, 9 * entries);
  prefetch<false>(entry_places_.data() + front.entries_begin, entries);
}

template <class S>
void Cholesky<S>::fill_panel(const Front& front) {
  S* P = panel(front);
  dense::clear(P, static_cast<std::ptrdiff_t>(front.stride) * front.columns);
  for (std::size_t e = front.entries_begin; e < front.entries_end; ++e) {
    const S* block = values_.data() + 9 * e;
    S* corner = P + entry_places_[e];
    for (int c = 0; c < 3; ++c)
      for (int r = 0; r < 3; ++r) corner[c * front.stride + r] = block[3 * r + c];
  }
}

// Adds the columns of a child's update that the given segments hold (lower triangle) to `target`: the panel of the
// parent or its update, whose row 0 is row `row_shift` of the parent's front. Block by block, so that two writes to
// neighbouring rows are far apart in time.
template <class S>
void Cholesky<S>::add_child(const Front& child, std::size_t segments_begin, std::size_t segments_end, S* target,
                            int stride, int row_shift) {
  for (std::size_t s = segments_begin; s < segments_end; ++s) {
    const Segment columns = segments_[s];
    const S* from = update(child) + static_cast<std::size_t>(columns.source) * child.update_stride;
    S* to = target + static_cast<std::size_t>(columns.destination - row_shift) * stride - row_shift;
    for (int c = 0; c < columns.length; ++c) {
      dense::add_block(from + c * child.update_stride + columns.source + c, 0,
                       to + c * stride + columns.destination + c, 0, columns.length - c, 1);
    }
    for (std::size_t t = s + 1; t < child.segments_end; ++t) {
      const Segment rows = segments_[t];
      dense::add_block(from + rows.source, child.update_stride, to + rows.destination, stride, rows.length,
                       columns.length);
    }
  }
}

// Left-looking by blocks of columns: subtract what the columns before contribute, then factor the block.
template <class S>
bool Cholesky<S>::factor_panel(const Front& front) {
  S* P = panel(front);
  const int stride = front.stride;
  for (int j = 0; j < front.columns; j += dense::kColumns) {
    const int start = dense::vector_start<S>(j);
    S* C = P + static_cast<std::size_t>(j) * stride + start;
    if (front.columns - j >= dense::kColumns) {
      dense::multiply<S, dense::kColumns, dense::Write::kSubtract>(P + start, P + j, stride, C, stride, j,
                                                                   stride - start);
      if (!dense::factor_columns<S, dense::kColumns>(P, stride, j)) return false;
    } else {
      dense::multiply<S, 3, dense::Write::kSubtract>(P + start, P + j, stride, C, stride, j, stride - start);
      if (!dense::factor_columns<S, 3>(P, stride, j)) return false;
    }
  }
  return true;
}

// U = -L21 L21^T, lower triangle.
template <class S>
void Cholesky<S>::make_update(const Front& front) {
  const S* L21 = panel(front) + front.diagonal_rows;
  S* U = update(front);
  for (int j = 0; j < front.rows; j += dense::kColumns) {
    const int start = dense::vector_start<S>(j), rows = front.update_stride - start;
    S* C = U + static_cast<std::size_t>(j) * front.update_stride + start;
    if (front.rows - j >= dense::kColumns) {
      dense::multiply<S, dense::kColumns, dense::Write::kNegate>(L21 + start, L21 + j, front.stride, C,
                                                                 front.update_stride, front.columns, rows);
    } else {
      dense::multiply<S, 3, dense::Write::kNegate>(L21 + start, L21 + j, front.stride, C, front.update_stride,
                                                   front.columns, rows);
    }
  }
}

template <class S>
void Cholesky<S>::solve(std::span<S> b) const {
  assert(usable_ && b.size() == solution_.size());
  const FlushDenormals flush;
  permute_in(b);
  for (const Front& front : fronts_) solve_forward(front);
  for (std::size_t s = fronts_.size(); s-- > 0;) solve_backward(fronts_[s]);
  permute_out(b);
}

template <class S>
void Cholesky<S>::permute_in(std::span<const S> b) const {
  for (std::size_t k = 0; k < order_.size(); ++k) std::copy_n(b.data() + 3 * order_[k], 3, solution_.data() + 3 * k);
}

template <class S>
void Cholesky<S>::permute_out(std::span<S> b) const {
  for (std::size_t k = 0; k < order_.size(); ++k) std::copy_n(solution_.data() + 3 * k, 3, b.data() + 3 * order_[k]);
}

// Both ways, w = (the front's columns of x, then the rows below). Three columns at a time are solved by themselves,
// then subtracted from all rows of w at once. Vectors start above the diagonal, where P holds zeros, and cover the
// three columns' own rows, which are therefore put back.

// L y = b.
template <class S>
void Cholesky<S>::solve_forward(const Front& front) const {
  const S* P = panel(front);
  S *x = solution_.data(), *w = reinterpret_cast<S*>(front_vector_.data());
  std::fill_n(w, front.stride, S(0));
  std::copy_n(x + front.first_column, front.columns, w);
  for (int j = 0; j < front.columns; j += 3) dense::forward_step(P, front.stride, j, w);
  std::copy_n(w, front.columns, x + front.first_column);
  for (int r = 0; r < front.rows; r += 3) {
    S* to = x + 3 * row_positions_[front.rows_begin + r / 3];
    for (int d = 0; d < 3; ++d) to[d] += w[front.diagonal_rows + r + d];
  }
}

// L^T x = y.
template <class S>
void Cholesky<S>::solve_backward(const Front& front) const {
  S *x = solution_.data(), *w = reinterpret_cast<S*>(front_vector_.data());
  std::fill_n(w, front.stride, S(0));
  std::copy_n(x + front.first_column, front.columns, w);
  for (int r = 0; r < front.rows; r += 3)
    std::copy_n(x + 3 * row_positions_[front.rows_begin + r / 3], 3, w + front.diagonal_rows + r);
  for (int j = front.columns - 3; j >= 0; j -= 3) dense::backward_step(panel(front), front.stride, j, w);
  std::copy_n(w, front.columns, x + front.first_column);
}

template class Cholesky<float>;
template class Cholesky<double>;

}  // namespace finsight
