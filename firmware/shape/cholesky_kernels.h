// The dense kernels of the multifrontal Cholesky: products and triangular factorisation of panels, in whole vectors.
// Panels are column-major with a stride that is a multiple of the vector width, and their padding holds zeros.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>

#include "firmware/shape/simd.h"

namespace finsight::dense {

using Index = std::ptrdiff_t;

template <class S>
constexpr int kWidth = simd::kLanesOf<S>;

template <class S>
constexpr int padded(int rows) {
  return (rows + kWidth<S> - 1) / kWidth<S> * kWidth<S>;
}
// The last vector boundary at or before a row. Kernels start there: what they compute in the rows between is above the
// diagonal, where nothing is read (U) or zeros are put back (P).
template <class S>
constexpr int vector_start(int row) {
  return row / kWidth<S> * kWidth<S>;
}

// Vectors of rows that one tile of the kernel holds; with six columns they fill the register file without spilling.
#if defined(__AVX512F__) || defined(__aarch64__)
constexpr int kTileVectors = 4;
#else
constexpr int kTileVectors = 2;
#endif
// Columns are worked on six at a time, three for the rest: they always come in multiples of three.
constexpr int kColumns = 6;

enum class Write { kSubtract, kNegate };

// Zeroes whole vectors. (memset takes longer to start than a small panel takes to clear.)
template <class S>
inline void clear(S* to, Index count) {
  for (Index i = 0; i < count; i += kWidth<S>) simd::store(to + i, simd::Vector<S>{});
}

// Whether a lane is one of the first `count`: all bits set or none.
template <class S>
inline auto first_lanes(int count) {
  using Mask = decltype(simd::Vector<S>{} == simd::Vector<S>{});
  using Lane = simd::Scalar<Mask>;
  struct Table {
    Lane lanes[2 * kWidth<S>] = {};
    constexpr Table() { std::fill_n(lanes, kWidth<S>, Lane(-1)); }
  };
  static constexpr Table table;
  Mask mask;
  std::memcpy(&mask, table.lanes + kWidth<S> - count, sizeof mask);
  return mask;
}

// Adds a block of rows x columns to another, column by column. Whole vectors are read and written, so both blocks must
// be followed by at least a vector of memory; what follows is read, and written back as it was.
template <class S>
inline void add_block(const S* from, Index from_stride, S* to, Index to_stride, int rows, int columns) {
  using V = simd::Vector<S>;
  const int whole = rows / kWidth<S> * kWidth<S>;
  const auto mask = first_lanes<S>(rows - whole);
  for (int c = 0; c < columns; ++c, from += from_stride, to += to_stride) {
    for (int r = 0; r < whole; r += kWidth<S>) simd::store(to + r, V(simd::load(to + r) + simd::load(from + r)));
    if (whole == rows) continue;
    simd::store(to + whole, V(simd::load(to + whole) + (mask ? simd::load(from + whole) : V{})));
  }
}

// C = (C or 0) - A B^T for a tile of kVectors vectors of rows and kCount columns; A and B lie in the same panel.
template <class S, int kVectors, int kCount, Write kWrite>
inline void multiply_tile(const S* A, const S* B, Index stride, S* C, Index c_stride, int depth) {
  using V = simd::Vector<S>;
  V sum[kCount][kVectors];
#pragma GCC unroll 8  // all tile loops must unroll, or the sums leave their registers
  for (int j = 0; j < kCount; ++j)
#pragma GCC unroll 8
    for (int m = 0; m < kVectors; ++m) sum[j][m] = V{};
  for (int k = 0; k < depth; ++k, A += stride, B += stride) {
    V a[kVectors];
#pragma GCC unroll 8
    for (int m = 0; m < kVectors; ++m) a[m] = simd::load(A + m * kWidth<S>);
#pragma GCC unroll 8
    for (int j = 0; j < kCount; ++j)
#pragma GCC unroll 8
      for (int m = 0; m < kVectors; ++m) sum[j][m] += a[m] * B[j];
  }
#pragma GCC unroll 8
  for (int j = 0; j < kCount; ++j)
#pragma GCC unroll 8
    for (int m = 0; m < kVectors; ++m) {
      S* c = C + j * c_stride + m * kWidth<S>;
      simd::store(c, kWrite == Write::kSubtract ? V(simd::load(c) - sum[j][m]) : V(-sum[j][m]));
    }
}

template <class S, int kCount, Write kWrite>
void multiply(const S* A, const S* B, Index stride, S* C, Index c_stride, int depth, int rows) {
  constexpr int kTileRows = kTileVectors * kWidth<S>;
  for (; rows >= kTileRows; rows -= kTileRows, A += kTileRows, C += kTileRows)
    multiply_tile<S, kTileVectors, kCount, kWrite>(A, B, stride, C, c_stride, depth);
  switch (rows / kWidth<S>) {
    case 3:
      return multiply_tile<S, 3, kCount, kWrite>(A, B, stride, C, c_stride, depth);
    case 2:
      return multiply_tile<S, 2, kCount, kWrite>(A, B, stride, C, c_stride, depth);
    case 1:
      return multiply_tile<S, 1, kCount, kWrite>(A, B, stride, C, c_stride, depth);
    default:
      return;
  }
}

// Factors kCount columns of a panel, from column `first` on, whose earlier columns have been subtracted. The diagonal
// holds the inverses of the factor's diagonal afterwards.
template <class S, int kCount>
bool factor_columns(S* P, Index stride, int first) {
  using V = simd::Vector<S>;
  S D[kCount][kCount], inverse[kCount];
  S* corner = P + first * stride + first;
  for (int j = 0; j < kCount; ++j) {
    S pivot = corner[j * stride + j];
    for (int k = 0; k < j; ++k) pivot -= D[j][k] * D[j][k];
    if (!(pivot > 0 && pivot <= std::numeric_limits<S>::max())) return false;  // catches NaN too
    inverse[j] = 1 / std::sqrt(pivot);
    for (int i = j + 1; i < kCount; ++i) {
      S entry = corner[j * stride + i];
      for (int k = 0; k < j; ++k) entry -= D[i][k] * D[j][k];
      D[i][j] = entry * inverse[j];
    }
  }
  for (Index row = vector_start<S>(first + kCount); row < stride; row += kWidth<S>) {
    V x[kCount];
    for (int j = 0; j < kCount; ++j) {
      x[j] = simd::load(P + (first + j) * stride + row);
      for (int k = 0; k < j; ++k) x[j] -= x[k] * D[j][k];
      x[j] *= inverse[j];
      simd::store(P + (first + j) * stride + row, x[j]);
    }
  }
  for (int j = 0; j < kCount; ++j) {
    S* column = P + (first + j) * stride;
    std::fill(column + vector_start<S>(first), column + first + j, S(0));
    column[first + j] = inverse[j];
    for (int i = j + 1; i < kCount; ++i) column[first + i] = D[i][j];
  }
  return true;
}

// w: a vector of the panel's rows. Solves for entries j, j + 1, j + 2 and subtracts their columns from the rest.
template <class S>
inline void forward_step(const S* P, Index stride, int j, S* w) {
  const S *a = P + j * stride, *b = a + stride, *c = b + stride;
  const S x0 = w[j] * a[j];
  const S x1 = (w[j + 1] - a[j + 1] * x0) * b[j + 1];
  const S x2 = (w[j + 2] - a[j + 2] * x0 - b[j + 2] * x1) * c[j + 2];
  for (Index row = vector_start<S>(j); row < stride; row += kWidth<S>)
    simd::store(w + row, simd::Vector<S>(simd::load(w + row) - simd::load(a + row) * x0 - simd::load(b + row) * x1 -
                                         simd::load(c + row) * x2));
  w[j] = x0;
  w[j + 1] = x1;
  w[j + 2] = x2;
}

// Entries j, j + 1, j + 2 of L^T x = w, from the entries below, which are solved already.
template <class S>
inline void backward_step(const S* P, Index stride, int j, S* w) {
  const S *a = P + j * stride, *b = a + stride, *c = b + stride;
  const S y0 = w[j], y1 = w[j + 1], y2 = w[j + 2];
  w[j] = w[j + 1] = w[j + 2] = 0;
  simd::Vector<S> s0{}, s1{}, s2{};
  for (Index row = vector_start<S>(j); row < stride; row += kWidth<S>) {
    const simd::Vector<S> x = simd::load(w + row);
    s0 += simd::load(a + row) * x;
    s1 += simd::load(b + row) * x;
    s2 += simd::load(c + row) * x;
  }
  w[j + 2] = (y2 - simd::sum_lanes(s2)) * c[j + 2];
  w[j + 1] = (y1 - simd::sum_lanes(s1) - b[j + 2] * w[j + 2]) * b[j + 1];
  w[j] = (y0 - simd::sum_lanes(s0) - a[j + 1] * w[j + 1] - a[j + 2] * w[j + 2]) * a[j];
}

}  // namespace finsight::dense
