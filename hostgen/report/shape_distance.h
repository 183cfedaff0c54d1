// How far two shapes of the same mesh are apart.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>

namespace finsight::host {

/// Over all nodes; a and b: [3 * nodes].
template <class A, class B>
double largest_distance_mm(std::span<A> a, std::span<B> b) {
  double largest_sq = 0;
  for (std::size_t i = 0; i < a.size(); i += 3) {
    double sum = 0;
    for (std::size_t k = i; k < i + 3; ++k) {
      const double difference = static_cast<double>(a[k]) - static_cast<double>(b[k]);
      sum += difference * difference;
    }
    largest_sq = std::max(largest_sq, sum);
  }
  return std::sqrt(largest_sq);
}

}  // namespace finsight::host
