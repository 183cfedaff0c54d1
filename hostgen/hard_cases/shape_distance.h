// Distance between two shapes of the same mesh.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>

namespace finsight::host {

struct ShapeDistance {
  double worst_mm = 0, mean_mm = 0;  ///< over all nodes
};

/// a and b: [3 * nodes], of any two scalars.
template <class A, class B>
ShapeDistance shape_distance(std::span<A> a, std::span<B> b) {
  ShapeDistance distance;
  for (std::size_t i = 0; i < a.size(); i += 3) {
    double sum = 0;
    for (std::size_t k = i; k < i + 3; ++k) {
      const double difference = static_cast<double>(a[k]) - static_cast<double>(b[k]);
      sum += difference * difference;
    }
    const double mm = std::sqrt(sum);
    distance.worst_mm = std::max(distance.worst_mm, mm);
    distance.mean_mm += mm / static_cast<double>(a.size() / 3);
  }
  return distance;
}

}  // namespace finsight::host
