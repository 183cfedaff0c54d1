#include "firmware/touch/touch_stage.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>

#include "firmware/touch/features.h"
#include "firmware/touch/int8_network.h"
#include "firmware/touch/radius_network.h"

namespace finsight {

namespace {

// The touch error of a shaken finger as a part of Shake's second difference (hostgen render --event
// shaken).
constexpr float kShiftPerShake = 0.75F;

// Motions far beyond those of any finger overflow somewhere in the network.
bool is_finite(const Touch& touch) {
  return touch.point_mm.allFinite() && touch.contact_mm.allFinite() && std::isfinite(touch.radius_68_mm) &&
         touch.force_vector_n.allFinite() && touch.force_vector_sigma_n.allFinite() && touch.moment_nm.allFinite() &&
         touch.moment_sigma_nm.allFinite() && std::isfinite(touch.explained);
}

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

std::size_t seen_index(const std::array<bool, kPlates>& seen) {
  std::size_t pattern = 0;
  for (std::size_t p = 0; p < kPlates; ++p) pattern += seen[p] ? std::size_t{1} << p : 0;
  return pattern - 1;
}

TouchStage::TouchStage(const Model& model) : TouchStage(model.touch) {
  for (const std::int32_t node : model.shape.front_nodes) {
    face_mm_.extend(Vec3f(model.shape.rest_mm.data() + 3 * static_cast<std::size_t>(node)));
  }
}

TouchStage::TouchStage(const TouchModel& model, float largest_told) : model_(model), largest_told_(largest_told) {
  assert(model.first.inputs == TouchModel::kInputs && model.last.outputs == TouchModel::kOutputs);
  hidden_[0].resize(static_cast<std::size_t>(model.first.outputs));
  for (std::size_t i = 0; i < TouchModel::kRounded; ++i) {
    assert(model.middle[i].inputs == static_cast<int>(hidden_[i].size()));
    hidden_[i + 1].resize(static_cast<std::size_t>(model.middle[i].outputs));
  }
  assert(model.last.inputs == static_cast<int>(hidden_.back().size()));
}

Touch TouchStage::locate(const PlatePoses& poses, const PoseVector& motion, const Doubt& doubt) {
  Touch nothing;
  if (poses.quality == Quality::kInvalid || poses.seen_count() == 0 || !motion.allFinite()) return nothing;
  nothing.plate_motion_mm = plate_motion_mm(poses.plates);
  if (nothing.plate_motion_mm < model_.threshold_mm) return nothing;
  nothing.over_range = nothing.plate_motion_mm > model_.range_mm;
  if (nothing.over_range) return nothing;
  const Trust trust = trust_in(poses, nothing.plate_motion_mm, doubt.unknown_g);
  Touch touch = read(run_network(trust, motion), nothing.plate_motion_mm);
  if (!is_finite(touch)) return nothing;
  widen(trust, motion, doubt, poses.seen, touch);
  nothing.explained = touch.explained;
  nothing.unexplained = is_unexplained(touch, doubt.unknown_g);
  if (nothing.unexplained || !is_finite(touch) || !is_on_face(touch)) return nothing;
  withhold_untold(touch);
  touch.quality = Quality::kFresh;
  return touch;
}

bool TouchStage::is_unexplained(const Touch& touch, float unknown_g) const {
  constexpr float kMostKnown_g = 0.5F * kMaxUnknown_g;
  const float above = unknown_g < kMostKnown_g ? model_.explained_above : model_.explained_above_unknown_g;
  return touch.explained < above - less_likely_;
}

// For plate motions that no touch causes (a shaken hand, a knocked camera) the network may answer anything.
bool TouchStage::is_on_face(const Touch& touch) const {
  if (face_mm_.isEmpty()) return true;
  const Vec3f learnt_mm(model_.output_scale[0], model_.output_scale[1], model_.output_scale[2]);
  return touch.radius_68_mm < learnt_mm.norm() && face_mm_.exteriorDistance(touch.point_mm) <= 2 * touch.radius_68_mm;
}

// The wrench's force is the same vector in the base's frame. Its components' errors are taken as independent there,
// too.
void TouchStage::read_forces(const Outputs& outputs, Touch& touch) const {
  constexpr std::size_t kForce = 6, kMoment = 9, kForceSigma = TouchModel::kMeans + 3, kMomentSigma = kForceSigma + 3;
  for (int i = 0; i < 3; ++i) {
    const auto k = static_cast<std::size_t>(i);
    touch.force_vector_n[i] = outputs[kForce + k];
    touch.force_vector_sigma_n[i] = exp_float(outputs[kForceSigma + k]);
    touch.moment_nm[i] = outputs[kMoment + k];
    touch.moment_sigma_nm[i] = exp_float(outputs[kMomentSigma + k]);
  }
  touch.force_vector_n[0] = std::max(touch.force_vector_n[0], 0.0f);      // objects push; they do not pull
  const Eigen::Map<const Eigen::Matrix3f> axes(model_.face_axes.data());  // columns: normal, across, along
  touch.wrench_force_n = axes * touch.force_vector_n;
}

Touch TouchStage::read(const Outputs& outputs, float plate_motion_mm) const {
  Touch touch;
  touch.plate_motion_mm = plate_motion_mm;
  touch.point_mm = Vec3f(outputs[0], outputs[1], outputs[2]);
  touch.contact_mm = touch.point_mm + Vec3f(outputs[3], outputs[4], outputs[5]);
  read_forces(outputs, touch);
  const float* log_sigma = &outputs[TouchModel::kMeans];
  const Vec3f sigma_mm(exp_float(log_sigma[0]), exp_float(log_sigma[1]), exp_float(log_sigma[2]));
  touch.radius_68_mm = sigma_mm.norm();
  touch.explained = outputs.back();
  return touch;
}

float TouchStage::published_radius_mm(const Touch& touch, float unknown_g,
                                      const std::array<bool, kPlates>& seen) const {
  const float radius_mm = calibrated_radius_mm(model_.radius_curve, touch.plate_motion_mm, touch.radius_68_mm);
  const RadiusFeatures features = radius_features(touch, touch.explained + less_likely_, radius_mm, unknown_g);
  return model_.seen_factor[seen_index(seen)] * radius_factor(model_, features) * radius_mm;
}

// On another finger than the pack's the network must not read the plates' motion to the last micrometre: told of more
// noise, it errs less there and says by how much.
TouchStage::Trust TouchStage::trust_in(const PlatePoses& poses, float plate_motion_mm, float unknown_g) const {
  const float other = model_.noise_per_mm * plate_motion_mm;
  Trust trust{.noise = {}, .unknown_g = unknown_g};
  for (std::size_t p = 0; p < kPlates; ++p) {
    trust.noise[p] = network_noise(poses.seen[p], std::sqrt(poses.noise[p] * poses.noise[p] + other * other));
  }
  return trust;
}

const TouchStage::Outputs& TouchStage::run_network(const Trust& trust, const PoseVector& motion) {
  std::array<float, TouchModel::kInputs> inputs;
  touch_features(model_, motion, trust.noise, trust.unknown_g, inputs);
  forward(model_.first, inputs, hidden_[0]);
  activate(hidden_[0]);
  for (std::size_t i = 0; i < TouchModel::kRounded; ++i) {
    forward(model_.middle[i], hidden_[i], hidden_[i + 1]);
    activate(hidden_[i + 1]);
  }
  forward(model_.last, hidden_.back(), outputs_);
  for (std::size_t i = 0; i < outputs_.size(); ++i) {
    outputs_[i] = model_.output_mean[i] + model_.output_scale[i] * outputs_[i];
  }
  return outputs_;
}

void TouchStage::widen(const Trust& trust, const PoseVector& motion, const Doubt& doubt,
                       const std::array<bool, kPlates>& seen, Touch& touch) {
  float point_sq = model_.touch_tolerance_mm * model_.touch_tolerance_mm;
  // How hard a finger is pushed to bend so far goes with its stiffness.
  Vec3f force_sq = (model_.stiffness_tolerance * touch.force_vector_n).cwiseAbs2();
  Vec3f moment_sq = (model_.stiffness_tolerance * touch.moment_nm).cwiseAbs2();
  if (doubt.shaken_mm > 0) point_sq += kShiftPerShake * kShiftPerShake * doubt.shaken_mm * doubt.shaken_mm;
  const auto ask = [&](const PoseVector& change) {
    const Touch other = read(run_network(trust, motion + change), touch.plate_motion_mm);
    point_sq += (other.point_mm - touch.point_mm).squaredNorm();
    force_sq += (other.force_vector_n - touch.force_vector_n).cwiseAbs2();
    moment_sq += (other.moment_nm - touch.moment_nm).cwiseAbs2();
    touch.explained = std::max(touch.explained, other.explained);  // something of that may be the explanation
  };
  for (const PoseVector& change : doubt.changes) ask(change);
  for (int i = 0; i < kPoseDims && !doubt.is_from_rest; ++i) {
    ask((i % 6 < 3 ? model_.marker_tolerance_mm : model_.marker_tolerance_rad) * PoseVector::Unit(i));
  }
  const float radius_mm = published_radius_mm(touch, doubt.unknown_g, seen);
  touch.radius_68_mm = std::sqrt(radius_mm * radius_mm + point_sq);
  touch.force_vector_sigma_n = (touch.force_vector_sigma_n.cwiseAbs2() + force_sq).cwiseSqrt();
  touch.moment_sigma_nm = (touch.moment_sigma_nm.cwiseAbs2() + moment_sq).cwiseSqrt();
  const Eigen::Map<const Eigen::Matrix3f> axes(model_.face_axes.data());
  touch.wrench_force_sigma_n = (axes.cwiseAbs2() * touch.force_vector_sigma_n.cwiseAbs2()).cwiseSqrt();
  touch.force_n = touch.force_vector_n[0];
  touch.force_sigma_n = touch.force_vector_sigma_n[0];
}

// A deviation nearly as large as the spread of the touches that were learnt says that the plates do not tell the
// number: of friction along the face they hardly tell anything, since a push further up moves them alike.
void TouchStage::withhold_untold(Touch& touch) const {
  constexpr std::size_t kForce = 6, kMoment = 9;
  const auto spread = [&](std::size_t first) {
    return Vec3f(model_.output_scale[first], model_.output_scale[first + 1], model_.output_scale[first + 2]);
  };
  const auto withhold = [&](const Vec3f& learnt, Vec3f& value, Vec3f& sigma) {
    for (int i = 0; i < 3; ++i) {
      if (sigma[i] <= largest_told_ * learnt[i]) continue;
      value[i] = sigma[i] = std::numeric_limits<float>::quiet_NaN();
    }
  };
  const Eigen::Map<const Eigen::Matrix3f> axes(model_.face_axes.data());
  const Vec3f force_spread_n = spread(kForce);
  withhold((axes.cwiseAbs2() * force_spread_n.cwiseAbs2()).cwiseSqrt(), touch.wrench_force_n,
           touch.wrench_force_sigma_n);
  withhold(force_spread_n, touch.force_vector_n, touch.force_vector_sigma_n);
  withhold(spread(kMoment), touch.moment_nm, touch.moment_sigma_nm);
}

}  // namespace finsight
