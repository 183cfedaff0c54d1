// Draws what a camera sees of square markers on white paper: every pixel is the mean over many exact sight lines,
// then the lens's blur, then noise. Slow and simple; independent of hostgen's renderer.
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <vector>

#include "firmware/geometry/lens.h"
#include "firmware/types.h"

namespace finsight::test {

struct PaintedMarker {
  int id = 0;
  double size_mm = 8;
  Eigen::Isometry3d T_camera_marker = Eigen::Isometry3d::Identity();
};

/// The corner k of a marker in its own frame: clockwise from the top left as seen from +z.
Eigen::Vector3d marker_corner(double size_mm, int k);
Eigen::Vector2d project(const Lens& camera, const Eigen::Vector3d& point_mm);
std::array<Vec2f, 4> true_corners(const Lens& camera, const PaintedMarker& marker);

struct Paint {
  double blur_px = 0.7;      ///< standard deviation
  double read_noise = 1.5;   ///< grey levels
  double shot_noise = 0.15;  ///< times the root of the grey level
  double white = 205, black = 28, background = 70;
  double light_gradient = 0.25;  ///< relative change of the light from left to right
  int samples = 61;              ///< sight lines per pixel; a prime
};

class Image {
 public:
  Image(const Lens& camera, const Paint& paint);

  void add(const PaintedMarker& marker);

  /// With modules other than its id's.
  void add(const PaintedMarker& marker, const std::array<std::uint8_t, 36>& modules);

  /// Blur, uneven light, noise, rounding.
  std::vector<std::uint8_t> develop(std::uint64_t seed);

 private:
  float& at(int x, int y) { return grey_[static_cast<std::size_t>(y * camera_.width_px + x)]; }

  /// Of the paper, which is one module wider than the black square on every side.
  std::array<int, 4> bounds(const PaintedMarker& marker) const;

  double grey_along(const Eigen::Isometry3d& T_marker_camera, double size_mm,
                    const std::array<std::uint8_t, 36>& modules, const Eigen::Vector2d& ray, double behind) const;

  /// Along lines of `count` pixels, `step` apart; `lines` of them, `line_step` apart.
  void blur(int step, int count, int lines, int line_step);

  Lens camera_;
  Paint paint_;
  std::vector<float> grey_;
};

}  // namespace finsight::test
