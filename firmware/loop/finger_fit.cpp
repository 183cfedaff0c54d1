#include "firmware/loop/finger_fit.h"

#include <algorithm>
#include <cmath>

#include "firmware/model/model.h"

namespace finsight {

namespace {

/// Share of a change that a low-pass takes in `after_s`.
float low_pass(float after_s, float time_constant_s) { return -std::expm1(-after_s / time_constant_s); }

}  // namespace

std::array<float, FitValues::kTerms> fit_terms(const FitValues& fit, const Vec3f& point_mm) {
  const float u = (point_mm.x() - fit.face_middle_mm.x()) / fit.face_half_mm[0];
  const float v = (point_mm.y() - fit.face_middle_mm.y()) / fit.face_half_mm[1];
  return {1, u, v, v * v};
}

float force_scale_at(const FitValues& fit, const Vec3f& point_mm) {
  const auto terms = fit_terms(fit, point_mm);
  float slope = 0;
  for (std::size_t i = 0; i < fit.force_slope.size(); ++i) slope += fit.force_slope[i] * terms[i + 1];
  return fit.force_scale * std::exp(slope);
}

Hysteresis::Hysteresis(const FitValues& fit) : force_range_n_(fit.force_range_n) {
  // Half-way back from the full force every play up to a quarter of it has turned round and lags twice its width.
  float widest = 0;
  for (const float width : kPlays) widest += 2 * std::min(width, 0.25F);
  weight_ = fit.hysteresis / widest;
}

float Hysteresis::elastic_n(float force_n) const {
  float elastic_n = force_n - at_zero_n_;
  for (std::size_t i = 0; i < kPlays.size(); ++i) {
    const float width_n = kPlays[i] * force_range_n_;
    elastic_n += weight_ * (std::clamp(play_n_[i], force_n - width_n, force_n + width_n) - force_n);
  }
  return elastic_n;
}

// elastic_n() rises by 1 per newton, less up to a share that each play takes: the iteration shrinks the error by that.
float Hysteresis::force_n(float elastic_n) {
  constexpr int kIterations = 12;
  float force_n = elastic_n;
  for (int i = 0; i < kIterations; ++i) force_n += elastic_n - this->elastic_n(force_n);
  force_n = std::max(force_n, 0.0F);  // below the threshold of touches, where 0 is said instead of what is left
  follow(force_n);
  return force_n;
}

void Hysteresis::follow(float force_n) {
  for (std::size_t i = 0; i < kPlays.size(); ++i) {
    const float width_n = kPlays[i] * force_range_n_;
    play_n_[i] = std::clamp(play_n_[i], force_n - width_n, force_n + width_n);
  }
}

void Hysteresis::zero() {
  follow(0);
  at_zero_n_ += elastic_n(0);
}

// A standard linear solid: a constant force bends it like the elastic force f (1 + c (1 - exp(-t / T))). Solved for f,
// that is the elastic force less a share c / (1 + c) of its low-pass with the time constant T / (1 + c). Without a
// touch the elastic force counts as 0: what is left of it is below the threshold at which touches are published.
float FingerFit::without_creep(float force_n, float after_s) {
  if (fit_.creep_share <= 0) return force_n;
  lagging_n_ += (force_n - lagging_n_) * low_pass(after_s * (1 + fit_.creep_share), fit_.creep_s);
  return force_n - fit_.creep_share / (1 + fit_.creep_share) * lagging_n_;
}

// Around a force that stands still the inverted operator is steeper than an elastic one, so it would make the noise of
// every frame larger: what it adds is told from the mean of the last frames.
float FingerFit::of_hysteresis_n(float elastic_n, float after_s) {
  constexpr float kMean_s = 0.1F;
  steady_n_ += (elastic_n - steady_n_) * low_pass(after_s, kMean_s);
  return hysteresis_.force_n(steady_n_) - steady_n_;
}

void FingerFit::change_motions(PlatePoses& poses) const { add_motion(fit_.motion_change * pose_vector(poses), poses); }

void FingerFit::reset() {
  lagging_n_ = 0;
  steady_n_ = 0;
  last_ns_ = 0;
  hysteresis_.zero();
}

void FingerFit::apply(const Eigen::Matrix3f& face_axes, std::int64_t exposure_ns, Touch& touch) {
  constexpr double kSecondsPerNs = 1e-9;
  const auto passed_ns = static_cast<double>(std::max<std::int64_t>(exposure_ns - last_ns_, 0));
  const float after_s = last_ns_ == 0 ? 0 : static_cast<float>(kSecondsPerNs * passed_ns);
  last_ns_ = exposure_ns;
  const bool is_touched = touch.quality != Quality::kInvalid && touch.force_n > 0;
  const float scale = force_scale_at(fit_, touch.point_mm);
  const float elastic_n = is_touched ? scale * without_creep(touch.force_n, after_s) : without_creep(0, after_s);
  const float force_n = std::max(elastic_n + of_hysteresis_n(elastic_n, after_s), 0.0F);
  if (touch.quality == Quality::kInvalid) return;
  const float factor = is_touched ? force_n / touch.force_n : scale;
  touch.force_n *= factor;
  for (Vec3f* vector : {&touch.force_vector_n, &touch.wrench_force_n, &touch.moment_nm}) *vector *= factor;
  touch.force_sigma_n *= scale;
  for (Vec3f* sigma : {&touch.force_vector_sigma_n, &touch.wrench_force_sigma_n, &touch.moment_sigma_nm}) {
    *sigma *= scale;
  }
  const auto terms = fit_terms(fit_, touch.point_mm);
  float across_mm = 0, along_mm = 0;
  for (std::size_t i = 0; i < terms.size(); ++i) {
    across_mm += fit_.across_mm[i] * terms[i];
    along_mm += fit_.along_mm[i] * terms[i];
  }
  const Vec3f offset_mm = across_mm * face_axes.col(1) + along_mm * face_axes.col(2);
  touch.point_mm -= offset_mm;
  touch.contact_mm -= offset_mm;
}

}  // namespace finsight
