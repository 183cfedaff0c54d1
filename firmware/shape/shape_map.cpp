#include "firmware/shape/shape_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <string>

#include "firmware/input_error.h"

namespace finsight {

namespace {

using Features = std::array<float, ShapeMapModel::kFeatures>;

Features map_features(const Eigen::Matrix<float, 18, 1>& numbers, std::span<const float> scale) {
  Features features;
  float* x = features.data() + 1;
  features[0] = 1;
  for (int i = 0; i < 18; ++i) x[i] = scale[i] * numbers[i];
  for (int i = 0, k = 18; i < 18; ++i)
    for (int j = i; j < 18; ++j, ++k) x[k] = x[i] * x[j];
  return features;
}

}  // namespace

ShapeMap::ShapeMap(const ShapeMapModel& map, const ShapeModel& shape) : map_(map), rest_mm_(shape.rest_mm) {
  const auto check = [](const char* field, std::size_t found, std::size_t expected) {
    if (found != expected)
      throw InputError("shape map", field, std::to_string(found) + " numbers", std::to_string(expected));
  };
  const auto rank = static_cast<std::size_t>(std::max(map.rank, 0));
  check("scale", map.scale.size(), 18);
  check("weights", map.weights.size(), rank * ShapeMapModel::kFeatures);
  check("basis", map.basis.size(), rank * shape.rest_mm.size());
  prepare_measures(shape);
}

void ShapeMap::prepare_measures(const ShapeModel& shape) {
  const auto rank = static_cast<std::size_t>(map_.rank), nodes = rest_mm_.size() / 3;
  coefficients_.resize(rank);
  for (std::size_t k = 0; k < rank; ++k) {
    double sum = 0;
    for (std::size_t f = 0; f < ShapeMapModel::kFeatures; ++f) {
      const double weight = static_cast<double>(map_.weights[k * ShapeMapModel::kFeatures + f]);
      sum += weight * weight;
    }
    coefficient_scale_.push_back(sum > 0 ? static_cast<float>(1 / std::sqrt(sum)) : 0);
  }
  const auto basis = [&](std::size_t k, std::size_t i) { return map_.basis[k * rest_mm_.size() + i]; };
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

// x = rest + sum over the basis of (weights * features) * basis vector.
void ShapeMap::evaluate(const Eigen::Matrix<float, 18, 1>& numbers, std::span<float> node_mm) const {
  coefficients(numbers, coefficients_);
  std::copy(rest_mm_.begin(), rest_mm_.end(), node_mm.begin());
  for (std::size_t k = 0; k < coefficients_.size(); ++k) {
    const float* basis = map_.basis.data() + k * rest_mm_.size();
    for (std::size_t i = 0; i < node_mm.size(); ++i) node_mm[i] += coefficients_[k] * basis[i];
  }
}

void ShapeMap::coefficients(const Eigen::Matrix<float, 18, 1>& numbers, std::span<float> out) const {
  const Features features = map_features(numbers, map_.scale);
  for (std::size_t k = 0; k < out.size(); ++k) {
    const float* weights = map_.weights.data() + k * features.size();
    out[k] = 0;
    for (std::size_t f = 0; f < features.size(); ++f) out[k] += weights[f] * features[f];
  }
}

ShapeMap::Measures ShapeMap::measure(const Eigen::Matrix<float, 18, 1>& numbers) const {
  const std::size_t rank = coefficients_.size();
  coefficients(numbers, coefficients_);
  const auto root_of = [&](const std::vector<float>& form) {
    float sum = 0;
    for (std::size_t a = 0; a < rank; ++a) {
      for (std::size_t b = 0; b < rank; ++b) sum += coefficients_[a] * form[a * rank + b] * coefficients_[b];
    }
    return std::sqrt(std::max(sum, 0.0f));
  };
  float size_sq = 0;
  for (std::size_t k = 0; k < rank; ++k) {
    const float share = coefficients_[k] * coefficient_scale_[k];
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
      for (std::size_t d = 0; d < 3; ++d) u[d] += coefficients_[k] * node_basis_[3 * (n * rank + k) + d];
    }
    largest_sq = std::max(largest_sq, u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
  }
  return {root_of(all_form_), root_of(front_form_), std::sqrt(largest_sq)};
}

}  // namespace finsight
