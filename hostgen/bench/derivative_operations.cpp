#include "hostgen/bench/derivative_operations.h"

#include <cmath>

#include "firmware/shape/simd.h"

namespace finsight::host {

namespace {

ArithmeticCount done;

/// A float that counts what is done with it.
struct Counted {
  float value = 0;

  Counted operator-() const { return {-value}; }
  Counted operator+(Counted b) const { return ++done.additions, Counted{value + b.value}; }
  Counted operator-(Counted b) const { return ++done.additions, Counted{value - b.value}; }
  Counted operator*(Counted b) const { return ++done.multiplications, Counted{value * b.value}; }
  Counted operator/(Counted b) const { return ++done.divisions, Counted{value / b.value}; }
  Counted& operator+=(Counted b) { return *this = *this + b; }
  Counted& operator-=(Counted b) { return *this = *this - b; }
  Counted& operator*=(Counted b) { return *this = *this * b; }
  bool operator<(Counted b) const { return value < b.value; }
  bool operator>(Counted b) const { return value > b.value; }
};

}  // namespace

}  // namespace finsight::host

namespace finsight::simd {

template <>
struct ScalarOf<host::Counted> {
  using Type = float;
};
template <>
host::Counted splat<host::Counted>(double x) {
  return {static_cast<float>(x)};
}
template <>
host::Counted square_root<host::Counted>(const host::Counted& x) {
  return ++host::done.roots, host::Counted{std::sqrt(x.value)};
}

}  // namespace finsight::simd

// The formulas themselves, for one more type of number.
#include "firmware/shape/element.cpp"

namespace finsight::host {

ArithmeticCount derivative_operations() {
  const Counted F[9] = {{1.1F}, {0.1F}, {0}, {0}, {0.9F}, {0.05F}, {0.02F}, {0}, {1}};
  const Counted B[9] = {{1}, {0}, {0}, {0}, {1}, {0}, {0}, {0}, {1}};
  Counted g[12], H[90];
  done = {};
  element_hessian(F, B, Counted{1}, g, H);
  return done;
}

}  // namespace finsight::host
