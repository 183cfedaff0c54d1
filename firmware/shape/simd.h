// Vectors of floats or doubles as wide as the target's registers, by the compiler's vector extensions: one source for
// AVX-512, AVX, SSE and NEON. Code written for a type T below works for plain float and double too.
#pragma once

#include <cmath>
#include <cstddef>
#include <type_traits>
#include <utility>

namespace finsight::simd {

#if defined(__AVX512F__)
inline constexpr std::size_t kVectorBytes = 64;
#elif defined(__AVX__)
inline constexpr std::size_t kVectorBytes = 32;
#else
inline constexpr std::size_t kVectorBytes = 16;
#endif

template <class S>
inline constexpr int kLanesOf = kVectorBytes / sizeof(S);

template <class S>
struct VectorOf {
  typedef S Type __attribute__((vector_size(kVectorBytes)));
};
/// kLanesOf<S> numbers of type S. Arithmetic, comparison and `condition ? a : b` act lane by lane.
template <class S>
using Vector = typename VectorOf<S>::Type;

template <class T>
struct ScalarOf {
  using Type = std::remove_reference_t<decltype(T{}[0])>;
};
template <>
struct ScalarOf<float> {
  using Type = float;
};
template <>
struct ScalarOf<double> {
  using Type = double;
};
/// The type of one lane of T; T itself if T is a plain number.
template <class T>
using Scalar = typename ScalarOf<T>::Type;

template <class T>
inline constexpr int kLanes = sizeof(T) / sizeof(Scalar<T>);

/// The same number in every lane. (x - 0 and not x + 0: the compiler may drop it even for x = -0.)
template <class T>
inline T splat(double x) {
  return static_cast<Scalar<T>>(x) - T{};
}

/// A vector from memory, and back; no alignment needed.
template <class S>
inline Vector<S> load(const S* from) {
  typedef S Unaligned __attribute__((vector_size(kVectorBytes), aligned(alignof(S)), may_alias));
  return *reinterpret_cast<const Unaligned*>(from);
}
template <class S>
inline void store(S* to, const Vector<S>& x) {
  typedef S Unaligned __attribute__((vector_size(kVectorBytes), aligned(alignof(S)), may_alias));
  *reinterpret_cast<Unaligned*>(to) = x;
}

/// Four numbers, from memory and back; no alignment needed.
template <class S>
struct FourVectorOf {
  typedef S Type __attribute__((vector_size(4 * sizeof(S))));
};
template <class S>
using FourOf = typename FourVectorOf<S>::Type;
template <class S>
inline FourOf<S> load_four(const S* from) {
  typedef S Unaligned __attribute__((vector_size(4 * sizeof(S)), aligned(alignof(S)), may_alias));
  return *reinterpret_cast<const Unaligned*>(from);
}
template <class S>
inline void store_four(S* to, const FourOf<S>& x) {
  typedef S Unaligned __attribute__((vector_size(4 * sizeof(S)), aligned(alignof(S)), may_alias));
  *reinterpret_cast<Unaligned*>(to) = x;
}

/// Exchanges rows and columns in each group of four lanes of four vectors: x[j] gets lane 4 g + j of all four at the
/// lanes 4 g to 4 g + 3.
template <class V>
inline void transpose_by_four(V x[4]) {
  constexpr int kCount = kLanes<V>;
  const auto interleave = [](const V& a, const V& b, auto pick) {
    return [&]<int... I>(std::integer_sequence<int, I...>) { return __builtin_shufflevector(a, b, pick(I)...); }
    (std::make_integer_sequence<int, kCount>());
  };
  // Of each group, the first two lanes of a and b in turn, or the last two.
  constexpr auto kLow = [](int i) { return i / 4 * 4 + i % 4 / 2 + (i % 2) * kCount; };
  constexpr auto kHigh = [](int i) { return i / 4 * 4 + 2 + i % 4 / 2 + (i % 2) * kCount; };
  const V a = interleave(x[0], x[2], kLow), b = interleave(x[1], x[3], kLow);
  const V c = interleave(x[0], x[2], kHigh), d = interleave(x[1], x[3], kHigh);
  x[0] = interleave(a, b, kLow);
  x[1] = interleave(a, b, kHigh);
  x[2] = interleave(c, d, kLow);
  x[3] = interleave(c, d, kHigh);
}

/// f of every lane. Compilers turn the loop into one instruction where the target has it (sqrt).
template <class T, class Function>
inline T map_lanes(const T& x, Function f) {
  if constexpr (kLanes<T> == 1) {
    return f(x);
  } else {
    T result;
    for (int i = 0; i < kLanes<T>; ++i) result[i] = f(x[i]);
    return result;
  }
}

template <class T>
inline T square_root(const T& x) {
  return map_lanes(x, [](Scalar<T> lane) { return std::sqrt(lane); });
}

/// The sum of all lanes, added in pairs.
template <class T>
inline Scalar<T> sum_lanes(const T& x) {
  Scalar<T> parts[kLanes<T>];
  for (int i = 0; i < kLanes<T>; ++i) parts[i] = x[i];
  for (int half = kLanes<T> / 2; half > 0; half /= 2)
    for (int i = 0; i < half; ++i) parts[i] += parts[i + half];
  return parts[0];
}

template <class T>
inline T larger(const T& a, const T& b) {
  return a > b ? a : b;
}
template <class T>
inline T smaller(const T& a, const T& b) {
  return a < b ? a : b;
}

}  // namespace finsight::simd
