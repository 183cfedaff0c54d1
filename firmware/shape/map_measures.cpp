#include "firmware/shape/map_measures.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numeric>

namespace finsight {

MapMeasures::MapMeasures(const ShapeMapModel& map, const ShapeModel& shape) {
  const auto rank = static_cast<std::size_t>(map.rank), coordinates = shape.rest_mm.size(), nodes = coordinates / 3;
  for (std::size_t k = 0; k < rank; ++k) {
    double sum = 0;
    for (std::size_t f = 0; f < ShapeMapModel::kFeatures; ++f) {
      const double weight = static_cast<double>(map.weights[k * ShapeMapModel::kFeatures + f]);
      sum += weight * weight;
    }
    coefficient_scale_.push_back(sum > 0 ? static_cast<float>(1 / std::sqrt(sum)) : 0);
  }
  const auto basis = [&](std::size_t k, std::size_t i) { return map.basis[k * coordinates + i]; };
  const auto form = [&](std::span<const std::int32_t> of_nodes, std::vector<float>& out) {
    out.resize(rank * rank);
    for (std::size_t a = 0; a < rank; ++a) {
      for (std::size_t b = 0; b < rank; ++b) {
        double sum = 0;
        for (const std::int32_t node : of_nodes) {
          const auto first = 3 * static_cast<std::size_t>(node);
          for (std::size_t i = first; i < first + 3; ++i) {
            sum += static_cast<double>(basis(a, i)) * static_cast<double>(basis(b, i));
          }
        }
        out[a * rank + b] = static_cast<float>(sum / static_cast<double>(std::max<std::size_t>(of_nodes.size(), 1)));
      }
    }
  };
  std::vector<std::int32_t> all(nodes);
  std::iota(all.begin(), all.end(), 0);
  form(all, all_form_);
  form(shape.front_nodes, front_form_);

  // Cauchy and Schwarz: |B c| <= |B S| |c / S|, where S is the size of each coefficient.
  std::vector<float> bound(nodes);
  for (std::size_t node = 0; node < nodes; ++node) {
    double sum = 0;
    for (std::size_t k = 0; k < rank; ++k) {
      for (std::size_t i = 3 * node; i < 3 * node + 3; ++i) {
        const float part = coefficient_scale_[k] > 0 ? basis(k, i) / coefficient_scale_[k] : 0;
        sum += static_cast<double>(part) * static_cast<double>(part);
      }
    }
    bound[node] = static_cast<float>(std::sqrt(sum));
  }
  std::sort(all.begin(), all.end(), [&](std::int32_t a, std::int32_t b) { return bound[a] > bound[b]; });
  for (const std::int32_t node : all) {
    node_bound_.push_back(bound[node]);
    for (std::size_t k = 0; k < rank; ++k) {
      for (std::size_t d = 0; d < 3; ++d) node_basis_.push_back(basis(k, 3 * static_cast<std::size_t>(node) + d));
    }
  }
}

ShapeMeasures MapMeasures::measure(std::span<const float> coefficients) const {
  const std::size_t rank = coefficients.size();
  const auto root_of = [&](const std::vector<float>& form) {
    float sum = 0;
    for (std::size_t a = 0; a < rank; ++a) {
      for (std::size_t b = 0; b < rank; ++b) sum += coefficients[a] * form[a * rank + b] * coefficients[b];
    }
    return std::sqrt(std::max(sum, 0.0f));
  };
  float size_sq = 0;
  for (std::size_t k = 0; k < rank; ++k) {
    const float share = coefficients[k] * coefficient_scale_[k];
    size_sq += share * share;
  }
  // Nodes in the order of their bounds, until none of the rest can be displaced further than one already is.
  const float size = std::sqrt(size_sq);
  float largest_sq = 0;
  for (std::size_t n = 0; n < node_bound_.size(); ++n) {
    const float bound = node_bound_[n] * size;
    if (bound * bound < largest_sq) break;
    float u[3] = {0, 0, 0};
    for (std::size_t k = 0; k < rank; ++k) {
      for (std::size_t d = 0; d < 3; ++d) u[d] += coefficients[k] * node_basis_[3 * (n * rank + k) + d];
    }
    largest_sq = std::max(largest_sq, u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
  }
  return {root_of(all_form_), root_of(front_form_), std::sqrt(largest_sq)};
}

}  // namespace finsight
