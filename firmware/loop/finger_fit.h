// What known weights have told about one finger, applied to its touches.
#pragma once

#include <array>
#include <cstdint>

#include "firmware/types.h"

namespace finsight {

/// Of one finger, relative to the one that its pack was made for. `hostgen fit` measures it.
struct FitValues {
  std::uint32_t model_checksum = 0;  ///< of the pack that it was measured with
  std::uint16_t fitted_on = 0;       ///< days since 2000-01-01
  float force_scale = 1;             ///< force over what the pack says
  float force_sigma = 0;             ///< relative standard deviation of forces that the fit leaves
  float force_scale_sigma = 0;       ///< that of force_scale itself
  /// A force that lasts bends the finger further, by this share in the end; 0: not known.
  float creep_share = 0;
  float creep_s = 1;  ///< time constant of that
  /// How far touches are published beside where they are, across the finger and along it, as polynomials of the place:
  /// offset = c0 + c1 u + c2 v + c3 v^2, u and v being -1 to 1 over the face.
  static constexpr int kTerms = 4;
  std::array<float, kTerms> across_mm{}, along_mm{};
  Vec3f face_middle_mm = Vec3f::Zero();     ///< where u and v are 0
  std::array<float, 2> face_half_mm{1, 1};  ///< where u and v are 1, from there
  float touch_radius_mm = 0;                ///< 68 % of what this leaves of the touches' offset is smaller
};

/// The polynomials' terms at a touch.
std::array<float, FitValues::kTerms> offset_terms(const FitValues& fit, const Vec3f& point_mm);

class FingerFit {
 public:
  explicit FingerFit(const FitValues& fit) : fit_(fit) {}

  /// Once per frame with fresh plates: corrects the touch, if there is one. `face_axes`: columns normal, across, along.
  void apply(const Eigen::Matrix3f& face_axes, std::int64_t exposure_ns, Touch& touch);
  void reset() { *this = FingerFit(fit_); }

 private:
  float recovered(float force_n, std::int64_t exposure_ns);

  FitValues fit_;
  float lagging_n_ = 0;  ///< low-pass of the force that bends an elastic finger so
  std::int64_t last_ns_ = 0;
};

}  // namespace finsight
