// Fingers as they come from a workshop: each differs from its spec, and its material remembers what touched it. Fit,
// verification and their figures are proved on such fingers.
#pragma once

#include <array>
#include <cstdint>

#include "firmware/geometry/lens.h"
#include "hostgen/finger/spec.h"
#include "hostgen/render/touch_path.h"
#include "hostgen/util/random.h"

namespace finsight::host {

/// How much fingers of one drawing differ. Every number is drawn evenly from its range, each finger's from its own.
struct Workshop {
  /// Relative to the spec's. Polyurethane of nominal 90 Shore A, where the spec says 10 MPa: 7 to 13 MPa.
  std::array<double, 2> youngs_modulus = {0.7, 1.3};
  double wall_mm = 0.3;        ///< front, back and side walls, each to either side; only of a finger drawn by numbers
  double marker_mm = 0.5;      ///< how far a marker is stuck beside its place at most, in any direction
  double marker_deg = 1.5;     ///< and turned
  double camera_mm = 1;        ///< how far the camera is mounted from its place at most, in any direction
  double camera_deg = 1.5;     ///< and turned
  double focal_length = 0.01;  ///< relative, to either side
  double principal_point_px = 5;               ///< of an image 1280 pixels wide, in any direction
  std::array<double, 2> creep = {0.05, 0.15};  ///< how much further a constant force bends the finger in 60 s, relative
  std::array<double, 2> creep_s = {5, 60};     ///< time constant of that
  std::array<double, 2> hysteresis = {0.03, 0.10};  ///< widest gap between loading and unloading, of the full force
  /// Relative change of Young's modulus per kelvin, and how far the temperature of use is from that of the fit at most.
  std::array<double, 2> per_kelvin = {-0.006, -0.002};
  double kelvin = 5;
};

/// A standard linear solid with dry friction inside: how a finger bends under a changing force is how it bends at once
/// under the force that this returns.
class MaterialMemory {
 public:
  /// creep: share of the elastic answer that is added in the end, with this time constant; hysteresis: see Workshop.
  MaterialMemory(double creep, double creep_s, double hysteresis, double full_force_n);
  /// `force_n` acts since the last call, `after_s` ago.
  double bends_as_n(double force_n, double after_s);

 private:
  // Plays of several widths in a row (Prandtl and Ishlinskii): each follows the force at a distance.
  static constexpr std::array<double, 5> kPlayWidths = {0.02, 0.04, 0.08, 0.16, 0.32};  ///< of the full force
  double creep_, creep_s_, play_weight_, full_force_n_;
  double crept_n_ = 0;
  std::array<double, 5> play_n_{};
};

/// One finger of the workshop and its camera, as they really are.
struct VirtualFinger {
  std::uint64_t number = 0;
  FingerSpec spec;   ///< its walls, Young's modulus, markers' and camera's places, and lenses
  double creep = 0;  ///< in the end; that after 60 s is the workshop's
  double creep_s = 1;
  double hysteresis = 0;
  double per_kelvin = 0;
  double kelvin = 0;  ///< temperature of use minus that of the fit

  /// Of a finger that nothing has touched yet.
  MaterialMemory memory() const { return {creep, creep_s, hysteresis, spec.force_n[1]}; }
  /// What `force_n` is at the temperature of the fit, for the same deformation.
  double at_fit_temperature_n(double force_n) const { return force_n / (1 + per_kelvin * kelvin); }
};

/// How the loads of a session, at `frames_per_second`, bend this finger. Temperature apart, which nothing tells.
void remember(const VirtualFinger& finger, double frames_per_second, std::vector<TouchLoad>& loads);

/// The same spec and number give the same finger.
VirtualFinger draw_finger(const FingerSpec& spec, std::uint64_t number, const Workshop& workshop = {});

/// The spec with other walls. A wall grows to its inside: what touches the finger stays where it is, and so do the
/// plates. Without effect on a finger whose surface comes from a file.
FingerSpec with_walls(const FingerSpec& spec, double front_mm, double back_mm, double side_mm);

}  // namespace finsight::host
