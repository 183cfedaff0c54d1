// Static supernodal multifrontal Cholesky of a sparse symmetric matrix of 3x3 blocks. Symbolic work was done once by
// hostgen (CholeskyPlan); here is only arithmetic, in memory taken at construction.
#pragma once

#include <atomic>
#include <cstddef>
#include <span>
#include <vector>

#include "firmware/model/model.h"
#include "firmware/shape/simd.h"

namespace finsight {

/// S is float or double. Usage per frame: fill values() (lower block pattern of the plan, each 3x3 block row-major),
/// factor(), then solve() as often as wanted. Nothing allocates after the constructor. One object per thread.
template <class S>
class Cholesky {
 public:
  /// Copies what it needs of the plan. Throws InputError if the plan is inconsistent: not an elimination order,
  /// supernodes or rows not ascending, or a pattern that its fronts cannot hold.
  explicit Cholesky(const CholeskyPlan& plan);
  Cholesky(const Cholesky&) = delete;
  Cholesky& operator=(const Cholesky&) = delete;

  /// [9 * pattern_row.size()] the Hessian's blocks, in the order of plan.pattern_row. factor() leaves them as they are.
  std::span<S> values() { return values_; }
  /// Index of the 3x3 block (row, column) of free nodes among values(); `transposed` tells that the stored block is
  /// (column, row). Throws InputError if the pattern has no such block.
  struct BlockPlace {
    std::size_t index;
    bool transposed;
  };
  BlockPlace place(int row, int column) const;
  /// Elimination position of a free node.
  int position(int free_node) const { return position_[free_node]; }
  /// False if a pivot is not positive or not finite; the factor is then unusable until the next success.
  [[nodiscard]] bool factor();
  /// factor(), then solve(b), in less time: each front's part of L y = b is done while the front is in the cache. On
  /// failure b stays as it is.
  [[nodiscard]] bool factor_and_solve(std::span<S> b);
  /// Solves A x = b in place; b: [3 * blocks] in the order of free nodes (not of elimination).
  void solve(std::span<S> b) const;
  /// The same for a right-hand side per lane, which together take little longer than one. For the workstation: it takes
  /// memory.
  void solve(std::span<simd::Vector<S>> b) const;

  /// factor() also gives up, and returns false, once `*stop` holds: on the workstation some take many seconds.
  void give_up_when(const std::atomic<bool>& stop) { stop_ = &stop; }
  /// Multiply-adds of one factorisation, for reports.
  double factor_operations() const;

 private:
  // Contiguous rows of a child's update that go to contiguous rows of its parent's front.
  struct Segment {
    int source, destination, length;
  };
  // A supernode's dense front. Its panel holds the factor's columns: `columns` of them, column-major, `stride` apart;
  // first the rows of the diagonal block (padded to diagonal_rows), then the rows below (padded too), so that both
  // parts start on a vector. Its update holds the lower triangle that goes to the parent: rows x rows, update_stride
  // apart.
  struct Front {
    int first_column = 0;  // elimination position of the first column, in scalars
    int columns = 0, rows = 0;
    int diagonal_rows = 0, stride = 0, update_stride = 0;
    std::size_t panel = 0, update = 0;                                     // offsets
    std::size_t entries_begin = 0, entries_end = 0;                        // of the pattern
    std::size_t rows_begin = 0;                                            // in row_positions_
    std::size_t children_begin = 0, children_end = 0;                      // in children_
    std::size_t segments_begin = 0, segments_split = 0, segments_end = 0;  // before the split: to the parent's panel
  };

  void make_fronts(const CholeskyPlan& plan);
  void connect_fronts(const CholeskyPlan& plan);
  void place_updates();
  void place_entries(const CholeskyPlan& plan);
  int front_row(const CholeskyPlan& plan, std::size_t front, int position) const;
  S* panel(const Front& front) { return reinterpret_cast<S*>(panels_.data()) + front.panel; }
  const S* panel(const Front& front) const { return reinterpret_cast<const S*>(panels_.data()) + front.panel; }
  S* update(const Front& front) { return reinterpret_cast<S*>(updates_.data()) + front.update; }
  void prefetch_for_factor(const Front& front) const;
  void fill_panel(const Front& front);
  void add_child(const Front& child, std::size_t segments_begin, std::size_t segments_end, S* target, int stride,
                 int row_shift);
  bool factor_panel(const Front& front);
  bool factor_fronts(bool and_solve_forward);
  void permute_in(std::span<const S> b) const;
  void permute_out(std::span<S> b) const;
  void solve_forward(const Front& front) const;
  void solve_backward(const Front& front) const;
  void solve_forward(const Front& front, simd::Vector<S>* x, simd::Vector<S>* w) const;
  void solve_backward(const Front& front, simd::Vector<S>* x, simd::Vector<S>* w) const;
  void make_update(const Front& front);

  std::vector<std::int32_t> order_, position_;
  std::vector<std::int32_t> pattern_start_, pattern_row_;
  std::vector<Front> fronts_;
  std::vector<std::size_t> children_;
  std::vector<Segment> segments_;
  std::vector<std::int32_t> row_positions_;  // plan.rows
  std::vector<std::int32_t> entry_places_;   // of every pattern block: offset of its corner in its front's panel
  std::vector<S> values_;
  std::vector<simd::Vector<S>> panels_, updates_;
  mutable std::vector<simd::Vector<S>> front_vector_;  // solve: the part of x that one front works on
  mutable std::vector<S> solution_;                    // solve: x in elimination order
  const std::atomic<bool>* stop_ = nullptr;
  bool usable_ = false;
};

extern template class Cholesky<float>;
extern template class Cholesky<double>;

}  // namespace finsight
