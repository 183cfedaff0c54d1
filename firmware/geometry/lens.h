// The camera's lens: pinhole with Brown-Conrady distortion, OpenCV's convention (pixel centres at whole numbers). The
// only lens type and the only place where the distortion is written down; hostgen uses it too.
#pragma once

#include <Eigen/Core>
#include <array>

namespace finsight {

/// A calibrated lens; holds for one image size.
struct Lens {
  int width_px = 0, height_px = 0;
  double fx = 0, fy = 0, cx = 0, cy = 0;  ///< pixels
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0;

  bool operator==(const Lens&) const = default;
};

/// The numbers of a lens as one array, in the order that files and OpenCV have them.
inline constexpr int kLensNumbers = 9;
inline constexpr std::array<const char*, kLensNumbers> kLensNames = {"fx", "fy", "cx", "cy", "k1",
                                                                     "k2", "p1", "p2", "k3"};
using LensNumbers = std::array<double, kLensNumbers>;
inline LensNumbers lens_numbers(const Lens& lens) {
  return {lens.fx, lens.fy, lens.cx, lens.cy, lens.k1, lens.k2, lens.p1, lens.p2, lens.k3};
}
inline Lens make_lens(int width_px, int height_px, const LensNumbers& n) {
  return {width_px, height_px, n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8]};
}

/// The lens with its numbers rounded to single precision: what the frame loop has always worked with. Without that the
/// registers of a replayed session would differ between versions, by a count here and there.
Lens in_single_precision(const Lens& lens);

/// Focal lengths over the image's longer side. The shortest sees 157 degrees, where this lens model ends; the longest 3
/// degrees: over a whole metre no finger's markers fit into that.
inline constexpr double kShortestFocal = 0.1, kLongestFocal = 20;

/// Throws InputError (file "lens", with field, found and expected) for a size outside 16 ... 8192 pixels, focal
/// lengths that no such camera has, a principal point outside the image, and anything that is not finite.
void check_lens(const Lens& lens);
/// The same, of whatever size the images are.
void check_lens_numbers(const Lens& lens);

/// Where a direction of sight meets the image, and how the pixel moves with it.
struct Projection {
  Eigen::Vector2d pixel;
  Eigen::Matrix2d slope;  ///< d pixel / d ray
};
/// `ray` is (X / Z, Y / Z) of a point in the camera frame. Meaningless beyond turning_radius_sq().
Projection project_ray(const Lens& lens, const Eigen::Vector2d& ray);

/// Direction of sight -> pixel; meaningless beyond turning_radius_sq(), too.
Eigen::Vector2d pixel_from_ray(const Lens& lens, const Eigen::Vector2d& ray);

/// Pixel -> direction of sight, to `tolerance_px`. Not-a-number where the lens model folds over and has no inverse,
/// which happens beyond the corners of the image that it was calibrated for.
Eigen::Vector2d ray_from_pixel(const Lens& lens, const Eigen::Vector2d& pixel, double tolerance_px = 1e-6);

/// The squared length of the rays at which the image of the radial polynomial turns back towards the middle: longer
/// rays fold into pixels that belong to shorter ones. 100 (84 degrees off the axis) if that happens nowhere before.
double turning_radius_sq(const Lens& lens);

}  // namespace finsight
