#include "firmware/loop/finger_fit.h"

#include <algorithm>
#include <cmath>

namespace finsight {

std::array<float, FitValues::kTerms> offset_terms(const FitValues& fit, const Vec3f& point_mm) {
  const float u = (point_mm.x() - fit.face_middle_mm.x()) / fit.face_half_mm[0];
  const float v = (point_mm.y() - fit.face_middle_mm.y()) / fit.face_half_mm[1];
  return {1, u, v, v * v};
}

// A standard linear solid: a constant force bends it like the elastic force f (1 + c (1 - exp(-t / T))). Solved for f,
// that is the elastic force less a share c / (1 + c) of its low-pass with the time constant T / (1 + c). Without a
// touch the elastic force counts as 0: what is left of it is below the threshold at which touches are published.
float FingerFit::recovered(float force_n, std::int64_t exposure_ns) {
  constexpr double kSecondsPerNs = 1e-9;
  if (fit_.creep_share <= 0) return force_n;
  const float after_s =
      last_ns_ == 0 ? 0 : static_cast<float>(kSecondsPerNs * static_cast<double>(exposure_ns - last_ns_));
  last_ns_ = exposure_ns;
  const double cycles = -static_cast<double>(std::max(after_s, 0.0F) * (1 + fit_.creep_share) / fit_.creep_s);
  lagging_n_ += (force_n - lagging_n_) * static_cast<float>(-std::expm1(cycles));
  return force_n - fit_.creep_share / (1 + fit_.creep_share) * lagging_n_;
}

void FingerFit::apply(const Eigen::Matrix3f& face_axes, std::int64_t exposure_ns, Touch& touch) {
  const bool is_touched = touch.quality != Quality::kInvalid && touch.force_n > 0;
  const float force_n = recovered(is_touched ? touch.force_n : 0, exposure_ns);
  if (touch.quality == Quality::kInvalid) return;
  const float factor = fit_.force_scale * (is_touched ? std::max(force_n / touch.force_n, 0.0F) : 1);
  touch.force_n *= factor;
  for (Vec3f* vector : {&touch.force_vector_n, &touch.wrench_force_n, &touch.moment_nm}) *vector *= factor;
  touch.force_sigma_n *= fit_.force_scale;
  for (Vec3f* sigma : {&touch.force_vector_sigma_n, &touch.wrench_force_sigma_n, &touch.moment_sigma_nm}) {
    *sigma *= fit_.force_scale;
  }
  const auto terms = offset_terms(fit_, touch.point_mm);
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
