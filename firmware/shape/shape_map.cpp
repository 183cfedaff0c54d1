#include "firmware/shape/shape_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "firmware/input_error.h"

namespace finsight {

namespace {

// What noise and a touch at the edge of the face add to the training's largest number.
constexpr float kLargestScaled = 1.25f;

using Features = std::array<float, ShapeMapModel::kFeatures>;

Features map_features(const PoseVector& motion, std::span<const float> scale) {
  Features features;
  float* x = features.data() + 1;
  features[0] = 1;
  for (int i = 0; i < kPoseDims; ++i) x[i] = scale[i] * motion[i];
  for (int i = 0, k = kPoseDims; i < kPoseDims; ++i)
    for (int j = i; j < kPoseDims; ++j, ++k) x[k] = x[i] * x[j];
  return features;
}

}  // namespace

ShapeMap::ShapeMap(const ShapeMapModel& map, const ShapeModel& shape) : map_(map), rest_mm_(shape.rest_mm) {
  const auto check = [](const char* field, std::size_t found, std::size_t expected) {
    if (found != expected)
      throw InputError("shape map", field, std::to_string(found) + " numbers", std::to_string(expected));
  };
  const auto rank = static_cast<std::size_t>(std::max(map.rank, 0));
  check("scale", map.scale.size(), kPoseDims);
  check("weights", map.weights.size(), rank * ShapeMapModel::kFeatures);
  check("basis", map.basis.size(), rank * shape.rest_mm.size());
  coefficients_.resize(rank);
}

// x = rest + sum over the basis of (weights * features) * basis vector.
void ShapeMap::evaluate(const PoseVector& motion, std::span<float> node_mm) const {
  coefficients(motion);
  std::copy(rest_mm_.begin(), rest_mm_.end(), node_mm.begin());
  for (std::size_t k = 0; k < coefficients_.size(); ++k) {
    const float* basis = map_.basis.data() + k * rest_mm_.size();
    for (std::size_t i = 0; i < node_mm.size(); ++i) node_mm[i] += coefficients_[k] * basis[i];
  }
}

// The scale makes the largest of the training one.
bool ShapeMap::covers(const PoseVector& motion) const {
  for (int i = 0; i < kPoseDims; ++i) {
    if (!(std::abs(map_.scale[i] * motion[i]) <= kLargestScaled)) return false;
  }
  return true;
}

std::span<const float> ShapeMap::coefficients(const PoseVector& motion) const {
  const Features features = map_features(motion, map_.scale);
  for (std::size_t k = 0; k < coefficients_.size(); ++k) {
    const float* weights = map_.weights.data() + k * features.size();
    coefficients_[k] = 0;
    for (std::size_t f = 0; f < features.size(); ++f) coefficients_[k] += weights[f] * features[f];
  }
  return coefficients_;
}

}  // namespace finsight
