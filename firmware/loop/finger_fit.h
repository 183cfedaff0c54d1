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
  /// Force over what the pack says, in the middle of the face. Elsewhere its logarithm is greater by
  /// s0 u + s1 v + s2 v^2, u and v being -1 to 1 over the face: walls and markers change a finger here and there.
  float force_scale = 1;
  std::array<float, 3> force_slope{};
  float force_sigma = 0;        ///< relative standard deviation of forces that the fit leaves
  float force_scale_sigma = 0;  ///< that of force_scale itself
  /// A force that lasts bends the finger further, by this share in the end; 0: not known.
  float creep_share = 0;
  float creep_s = 1;  ///< time constant of that
  /// A finger bends less under a force that grows than under one that falls: widest gap between the two, which is
  /// half-way back from `force_range_n`, over that; 0: none.
  float hysteresis = 0;
  float force_range_n = 1;
  /// How far touches are published beside where they are, across the finger and along it, as polynomials of the place:
  /// offset = c0 + c1 u + c2 v + c3 v^2, u and v being -1 to 1 over the face.
  static constexpr int kTerms = 4;
  std::array<float, kTerms> across_mm{}, along_mm{};
  /// This times the plates' motion is to be added to it: what this finger's walls, markers and camera show otherwise
  /// than those that the pack was made for.
  Eigen::Matrix<float, kPoseDims, kPoseDims, Eigen::RowMajor> motion_change =
      Eigen::Matrix<float, kPoseDims, kPoseDims, Eigen::RowMajor>::Zero();
  Vec3f face_middle_mm = Vec3f::Zero();     ///< where u and v are 0
  std::array<float, 2> face_half_mm{1, 1};  ///< where u and v are 1, from there
  float touch_radius_mm = 0;                ///< 68 % of what this leaves of the touches' offset is smaller
  float noise_per_mm = 0;                   ///< see TouchModel
  /// How much less likely than the pack's limit motions may be before they count as unexplained (log-odds): this
  /// finger's own touches are so unlike the pack's.
  float explained_lower = 0;
};

/// 1, u, v and v^2 at a touch.
std::array<float, FitValues::kTerms> fit_terms(const FitValues& fit, const Vec3f& point_mm);
/// Force over what the pack says, at a touch.
float force_scale_at(const FitValues& fit, const Vec3f& point_mm);

/// The force of a material with dry friction inside, from the force that would bend an elastic one so: an inverted
/// operator of Prandtl and Ishlinskii. Starts as one that has rested for so long that no touch is left in it.
class Hysteresis {
 public:
  explicit Hysteresis(const FitValues& fit);
  /// Once per frame, as what came before counts. `elastic_n` is 0 at the last zero.
  float force_n(float elastic_n);
  /// The force that would bend an elastic finger as `force_n` would bend this one now.
  float elastic_n(float force_n) const;
  /// `force_n` acts now. As force_n(), where the force is known.
  void follow(float force_n);
  /// The finger is let go: `elastic_n` counts from here.
  void zero();

 private:
  static constexpr std::array<float, 3> kPlays = {0.03F, 0.1F, 0.3F};  ///< how far each lags, of the range of force

  float weight_, force_range_n_;
  std::array<float, kPlays.size()> play_n_{};
  float at_zero_n_ = 0;  ///< what touches had left in it then
};

class FingerFit {
 public:
  explicit FingerFit(const FitValues& fit) : fit_(fit), hysteresis_(fit) {}

  /// Applies FitValues::motion_change. Once per frame with fresh plates, before anything is told from them.
  void change_motions(PlatePoses& poses) const;
  /// Once per frame with fresh plates: corrects the touch, if there is one. `face_axes`: columns normal, across, along.
  void apply(const Eigen::Matrix3f& face_axes, std::int64_t exposure_ns, Touch& touch);
  /// The finger is let go and was zeroed.
  void reset();

 private:
  float without_creep(float force_n, float after_s);
  float of_hysteresis_n(float elastic_n, float after_s);

  FitValues fit_;
  Hysteresis hysteresis_;
  float lagging_n_ = 0;  ///< low-pass of the force that bends an elastic finger so, by creep's time
  float steady_n_ = 0;   ///< mean of the last frames' without creep
  std::int64_t last_ns_ = 0;
};

}  // namespace finsight
