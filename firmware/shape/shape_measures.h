// How far the finger is displaced: what registers show of a shape.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

namespace finsight {

struct ShapeMeasures {
  float rms_mm = 0, front_rms_mm = 0;  ///< RMS displacement of all nodes, and of the front face's
  float largest_mm = 0;                ///< largest displacement of any node
};

/// rest_mm, node_mm: [3 * nodes]; front_nodes: indices of nodes.
template <class S>
ShapeMeasures measure_shape(std::span<const float> rest_mm, std::span<const std::int32_t> front_nodes,
                            std::span<const S> node_mm) {
  const auto squared_mm2 = [&](std::size_t node) {
    double sum = 0;
    for (std::size_t i = 3 * node; i < 3 * node + 3; ++i) {
      const double u = static_cast<double>(node_mm[i]) - static_cast<double>(rest_mm[i]);
      sum += u * u;
    }
    return sum;
  };
  const auto root_of_mean = [](double sum, std::size_t count) {
    return static_cast<float>(std::sqrt(sum / static_cast<double>(std::max<std::size_t>(count, 1))));
  };
  double all = 0, front = 0, largest = 0;
  const std::size_t nodes = rest_mm.size() / 3;
  for (std::size_t node = 0; node < nodes; ++node) {
    const double u_sq = squared_mm2(node);
    all += u_sq;
    largest = std::max(largest, u_sq);
  }
  for (const std::int32_t node : front_nodes) front += squared_mm2(static_cast<std::size_t>(node));
  return {root_of_mean(all, nodes), root_of_mean(front, front_nodes.size()), static_cast<float>(std::sqrt(largest))};
}

}  // namespace finsight
