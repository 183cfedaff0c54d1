#include "firmware/touch/touch_stage.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "firmware/touch/features.h"
#include "firmware/touch/int8_network.h"

namespace finsight {

namespace {

// The touch error of a shaken finger as a part of Shake's second difference (hostgen render --event
// shaken).
constexpr float kShiftPerShake = 0.75F;

// Through double, whose last-digit differences between C libraries vanish in the rounding to float.
float exp_float(float x) { return static_cast<float>(std::exp(static_cast<double>(x))); }

float log_float(float x) { return static_cast<float>(std::log(static_cast<double>(x))); }

}  // namespace

float calibrated_radius_mm(std::span<const float> curve, float plate_motion_mm, float radius_mm) {
  std::size_t above = 0;  // first knot beyond the motion
  while (above < curve.size() && curve[above] <= plate_motion_mm) above += 3;
  const std::size_t right = std::min(above, curve.size() - 3), left = std::max<std::size_t>(above, 3) - 3;
  const float span_mm = curve[right] - curve[left];
  const float share = span_mm > 0 ? (plate_motion_mm - curve[left]) / span_mm : 0.0f;
  const auto at = [&](std::size_t i) { return curve[left + i] + share * (curve[right + i] - curve[left + i]); };
  return exp_float(at(1) + at(2) * log_float(radius_mm));
}

TouchStage::TouchStage(const Model& model) : TouchStage(model.touch) {
  for (const std::int32_t node : model.shape.front_nodes) {
    face_mm_.extend(Vec3f(model.shape.rest_mm.data() + 3 * static_cast<std::size_t>(node)));
  }
}

TouchStage::TouchStage(const TouchModel& model) : model_(model) {
  assert(model.layers[0].inputs == TouchModel::kInputs && model.layers[2].outputs == TouchModel::kOutputs);
  assert(model.layers[1].inputs == model.layers[0].outputs && model.layers[2].inputs == model.layers[1].outputs);
  for (std::size_t i = 0; i < 2; ++i) hidden_[i].resize(static_cast<std::size_t>(model.layers[i].outputs));
}

Touch TouchStage::locate(const PlatePoses& poses, const PoseVector& motion, float shaken_mm) {
  Touch touch;
  if (poses.quality == Quality::kInvalid || poses.seen_count() == 0 || !motion.allFinite()) return touch;
  for (const PlateMotion& plate : poses.plates) {
    touch.plate_motion_mm = std::max(touch.plate_motion_mm, plate.displacement_mm.norm());
  }
  if (touch.plate_motion_mm < model_.threshold_mm) return touch;
  touch.over_range = touch.plate_motion_mm > model_.range_mm;
  if (touch.over_range) return touch;
  const Touch located = run_network(poses, motion, touch.plate_motion_mm, shaken_mm);
  return located.quality == Quality::kFresh ? located : touch;
}

// For plate motions that no touch causes (a shaken hand, a knocked camera) the network may answer anything.
bool TouchStage::is_on_face(const Touch& touch) const {
  if (face_mm_.isEmpty()) return true;
  const Vec3f learnt_mm(model_.output_scale[0], model_.output_scale[1], model_.output_scale[2]);
  return touch.radius_68_mm < learnt_mm.norm() && face_mm_.exteriorDistance(touch.point_mm) <= 2 * touch.radius_68_mm;
}

// The wrench's force is the same vector in the base's frame. Its components' errors are taken as independent there,
// too.
void TouchStage::read_forces(std::span<const float, TouchModel::kOutputs> outputs, Touch& touch) const {
  const auto exp_of = [&](std::size_t i) { return exp_float(outputs[i]); };
  constexpr std::size_t kForce = 6, kMoment = 9, kForceSigma = TouchModel::kMeans + 3, kMomentSigma = kForceSigma + 3;
  for (int i = 0; i < 3; ++i) {
    const auto k = static_cast<std::size_t>(i);
    touch.force_vector_n[i] = outputs[kForce + k];
    touch.force_vector_sigma_n[i] = exp_of(kForceSigma + k);
    touch.moment_nm[i] = outputs[kMoment + k];
    touch.moment_sigma_nm[i] = exp_of(kMomentSigma + k);
  }
  touch.force_vector_n[0] = std::max(touch.force_vector_n[0], 0.0f);  // objects push; they do not pull
  touch.force_n = touch.force_vector_n[0];
  touch.force_sigma_n = touch.force_vector_sigma_n[0];
  const Eigen::Map<const Eigen::Matrix3f> axes(model_.face_axes.data());  // columns: normal, across, along
  touch.wrench_force_n = axes * touch.force_vector_n;
  touch.wrench_force_sigma_n = (axes.cwiseAbs2() * touch.force_vector_sigma_n.cwiseAbs2()).cwiseSqrt();
}

Touch TouchStage::run_network(const PlatePoses& poses, const PoseVector& motion, float plate_motion_mm,
                              float shaken_mm) {
  std::array<float, TouchModel::kInputs> inputs;
  std::array<float, TouchModel::kOutputs> outputs;
  touch_features(model_, motion, network_noise(poses), inputs);
  forward(model_.layers[0], inputs, hidden_[0], true);
  forward(model_.layers[1], hidden_[0], hidden_[1], true);
  forward(model_.layers[2], hidden_[1], outputs, false);
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    outputs[i] = model_.output_mean[i] + model_.output_scale[i] * outputs[i];
  }

  Touch touch;
  touch.plate_motion_mm = plate_motion_mm;
  touch.point_mm = Vec3f(outputs[0], outputs[1], outputs[2]);
  touch.contact_mm = touch.point_mm + Vec3f(outputs[3], outputs[4], outputs[5]);
  read_forces(outputs, touch);
  const float* log_sigma = &outputs[TouchModel::kMeans];
  const Vec3f sigma_mm(exp_float(log_sigma[0]), exp_float(log_sigma[1]), exp_float(log_sigma[2]));
  touch.radius_68_mm = calibrated_radius_mm(model_.radius_curve, plate_motion_mm, sigma_mm.norm());
  if (shaken_mm > 0) {
    const float shift_mm = kShiftPerShake * shaken_mm;
    touch.radius_68_mm = std::sqrt(touch.radius_68_mm * touch.radius_68_mm + shift_mm * shift_mm);
  }
  // Motions far beyond those of any finger overflow somewhere in the network.
  const bool finite = touch.point_mm.allFinite() && touch.contact_mm.allFinite() && std::isfinite(touch.radius_68_mm) &&
                      touch.force_vector_n.allFinite() && touch.force_vector_sigma_n.allFinite() &&
                      touch.moment_nm.allFinite() && touch.moment_sigma_nm.allFinite();
  if (finite && is_on_face(touch)) touch.quality = Quality::kFresh;
  return touch;
}

}  // namespace finsight
