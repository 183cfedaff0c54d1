#include "firmware/touch/radius_network.h"

#include <algorithm>

#include "firmware/touch/features.h"

namespace finsight {

RadiusFeatures radius_features(const Touch& touch, float log_odds, float radius_mm, float unknown_g) {
  constexpr float kLeastOdds = -5, kMostOdds = 6;  // that are told apart: touches of the scene lie between
  constexpr float kSmallestPush_n = 0.3F;          // a weaker one tells nothing about friction
  const float normal_n = std::max(touch.force_vector_n[0], kSmallestPush_n);
  return {touch.point_mm.x(),
          touch.point_mm.y(),
          log_float(touch.plate_motion_mm),
          std::clamp(log_odds, kLeastOdds, kMostOdds),
          touch.force_vector_n[1] / normal_n,
          touch.force_vector_n[2] / normal_n,
          log_float(radius_mm),
          log_float(touch.force_vector_sigma_n[0]),
          log_float(touch.force_vector_sigma_n[1]),
          log_float(touch.force_vector_sigma_n[2]),
          log_unknown_g(unknown_g)};
}

RadiusFeatures normalised(std::span<const float> radius_inputs, const RadiusFeatures& features) {
  constexpr float kFarthest = 3;
  RadiusFeatures inputs;
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    const float mean = radius_inputs[2 * i], scale = radius_inputs[2 * i + 1];
    inputs[i] = std::clamp(scale * (features[i] - mean), -kFarthest, kFarthest);
  }
  return inputs;
}

float radius_factor(const TouchModel& model, const RadiusFeatures& features) {
  constexpr float kLeastLogFactor = -1.2F, kMostLogFactor = 2;
  constexpr std::size_t kInputs = TouchModel::kRadiusFeatures, kHidden = TouchModel::kRadiusHidden;
  const RadiusFeatures inputs = normalised(model.radius_inputs, features);
  float log_factor = model.radius_output[kHidden];
  for (std::size_t k = 0; k < kHidden; ++k) {
    const std::span<const float> weights = model.radius_hidden.subspan(k * (kInputs + 1), kInputs + 1);
    float sum = weights[kInputs];
    for (std::size_t i = 0; i < kInputs; ++i) sum += weights[i] * inputs[i];
    log_factor += model.radius_output[k] * algebraic_silu(sum);
  }
  return exp_float(std::clamp(log_factor, kLeastLogFactor, kMostLogFactor));
}

}  // namespace finsight
