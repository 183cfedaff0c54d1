// Solving for many right-hand sides at once, one per lane: every number of the factor is fetched once for all of them.
#include <algorithm>
#include <cassert>

#include "firmware/shape/cholesky.h"
#include "firmware/shape/flush_denormals.h"

namespace finsight {

template <class S>
void Cholesky<S>::solve(std::span<simd::Vector<S>> b) const {
  assert(usable_ && b.size() == solution_.size());
  const FlushDenormals flush;
  std::vector<simd::Vector<S>> x(b.size()), w(front_vector_.size() * simd::kLanesOf<S>);
  for (std::size_t k = 0; k < order_.size(); ++k) std::copy_n(b.data() + 3 * order_[k], 3, x.data() + 3 * k);
  for (const Front& front : fronts_) solve_forward(front, x.data(), w.data());
  for (std::size_t s = fronts_.size(); s-- > 0;) solve_backward(fronts_[s], x.data(), w.data());
  for (std::size_t k = 0; k < order_.size(); ++k) std::copy_n(x.data() + 3 * k, 3, b.data() + 3 * order_[k]);
}

template <class S>
void Cholesky<S>::solve_forward(const Front& front, simd::Vector<S>* x, simd::Vector<S>* w) const {
  using V = simd::Vector<S>;
  std::fill_n(w, front.stride, V{});
  std::copy_n(x + front.first_column, front.columns, w);
  for (int j = 0; j < front.columns; j += 3) {
    const S *a = panel(front) + static_cast<std::ptrdiff_t>(j) * front.stride, *b = a + front.stride,
            *c = b + front.stride;
    const V x0 = w[j] *= a[j];
    const V x1 = w[j + 1] = (w[j + 1] - x0 * a[j + 1]) * b[j + 1];
    const V x2 = w[j + 2] = (w[j + 2] - x0 * a[j + 2] - x1 * b[j + 2]) * c[j + 2];
    for (int row = j + 3; row < front.stride; ++row) w[row] -= x0 * a[row] + x1 * b[row] + x2 * c[row];
  }
  std::copy_n(w, front.columns, x + front.first_column);
  for (int r = 0; r < front.rows; ++r) {
    x[3 * row_positions_[front.rows_begin + r / 3] + r % 3] += w[front.diagonal_rows + r];
  }
}

template <class S>
void Cholesky<S>::solve_backward(const Front& front, simd::Vector<S>* x, simd::Vector<S>* w) const {
  using V = simd::Vector<S>;
  std::fill_n(w, front.stride, V{});
  std::copy_n(x + front.first_column, front.columns, w);
  for (int r = 0; r < front.rows; ++r) {
    w[front.diagonal_rows + r] = x[3 * row_positions_[front.rows_begin + r / 3] + r % 3];
  }
  for (int j = front.columns - 3; j >= 0; j -= 3) {
    const S *a = panel(front) + static_cast<std::ptrdiff_t>(j) * front.stride, *b = a + front.stride,
            *c = b + front.stride;
    V s0 = w[j], s1 = w[j + 1], s2 = w[j + 2];
    for (int row = j + 3; row < front.stride; ++row) {
      s0 -= w[row] * a[row];
      s1 -= w[row] * b[row];
      s2 -= w[row] * c[row];
    }
    w[j + 2] = s2 * c[j + 2];
    w[j + 1] = (s1 - w[j + 2] * b[j + 2]) * b[j + 1];
    w[j] = (s0 - w[j + 1] * a[j + 1] - w[j + 2] * a[j + 2]) * a[j];
  }
  std::copy_n(w, front.columns, x + front.first_column);
}

#define FINSIGHT_LANES(S)                                                                           \
  template void Cholesky<S>::solve(std::span<simd::Vector<S>>) const;                               \
  template void Cholesky<S>::solve_forward(const Front&, simd::Vector<S>*, simd::Vector<S>*) const; \
  template void Cholesky<S>::solve_backward(const Front&, simd::Vector<S>*, simd::Vector<S>*) const
FINSIGHT_LANES(float);
FINSIGHT_LANES(double);
#undef FINSIGHT_LANES

}  // namespace finsight
