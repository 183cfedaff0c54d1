#include "firmware/touch/radius_network.h"

#include <algorithm>

#include "firmware/touch/features.h"
#include "firmware/touch/int8_network.h"

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
  std::array<float, TouchModel::kRadiusHidden> x{}, y;  // in turn what goes into a layer and what comes out of it
  std::ranges::copy(normalised(model.radius_inputs, features), x.begin());
  forward(model.radius[0], x, y);
  activate(y);
  forward(model.radius[1], y, x);
  activate(x);
  float log_factor = 0;
  forward(model.radius[2], x, {&log_factor, 1});
  return exp_float(std::clamp(log_factor, kLeastLogFactor, kMostLogFactor));
}

}  // namespace finsight
