// Draws what a camera sees of square markers on white paper: every pixel is the mean over many exact sight lines,
// then the lens's blur, then noise. Slow and simple; independent of hostgen's renderer.
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "firmware/geometry/lens.h"
#include "firmware/types.h"
#include "firmware/vision/aruco_compat.h"
#include "tests/random.h"

namespace finsight::test {

struct PaintedMarker {
  int id = 0;
  double size_mm = 8;
  Eigen::Isometry3d T_camera_marker = Eigen::Isometry3d::Identity();
};

/// The corner k of a marker in its own frame: clockwise from the top left as seen from +z.
inline Eigen::Vector3d marker_corner(double size_mm, int k) {
  return {(k == 1 || k == 2 ? 0.5 : -0.5) * size_mm, (k < 2 ? 0.5 : -0.5) * size_mm, 0};
}

inline Eigen::Vector2d project(const Lens& camera, const Eigen::Vector3d& point_mm) {
  return pixel_from_ray(camera, point_mm.head<2>() / point_mm.z());
}

inline std::array<Vec2f, 4> true_corners(const Lens& camera, const PaintedMarker& marker) {
  std::array<Vec2f, 4> corners;
  for (int k = 0; k < 4; ++k) {
    corners[static_cast<std::size_t>(k)] =
        project(camera, marker.T_camera_marker * marker_corner(marker.size_mm, k)).cast<float>();
  }
  return corners;
}

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
  Image(const Lens& camera, const Paint& paint)
      : camera_(camera), paint_(paint), grey_(pixels(), static_cast<float>(paint.background)) {}

  void add(const PaintedMarker& marker) { add(marker, marker_modules(marker.id)); }

  /// With modules other than its id's.
  void add(const PaintedMarker& marker, const std::array<std::uint8_t, 36>& modules) {
    const Eigen::Isometry3d T_marker_camera = marker.T_camera_marker.inverse();
    const std::array<int, 4> box = bounds(marker);
    const int n = paint_.samples, golden = static_cast<int>(std::lround(n / std::numbers::phi));
    for (int y = box[1]; y <= box[3]; ++y) {
      for (int x = box[0]; x <= box[2]; ++x) {
        double sum = 0;
        for (int i = 0; i < n; ++i) {
          // A lattice with one sample in every row and column, so that edges along rows are as fine as any.
          const double u = (i + 0.5) / n, v = (i * golden % n + 0.5) / n;
          const Eigen::Vector2d pixel(x + u - 0.5, y + v - 0.5);
          sum += grey_along(T_marker_camera, marker.size_mm, modules, ray_from_pixel(camera_, pixel), at(x, y));
        }
        at(x, y) = static_cast<float>(sum / n);
      }
    }
  }

  /// Blur, uneven light, noise, rounding.
  std::vector<std::uint8_t> develop(std::uint64_t seed) {
    blur(1, camera_.width_px, camera_.height_px, camera_.width_px);
    blur(camera_.width_px, camera_.height_px, camera_.width_px, 1);
    Random random(seed);
    std::vector<std::uint8_t> bytes(pixels());
    for (std::size_t i = 0; i < bytes.size(); ++i) {
      const double across = static_cast<double>(i % static_cast<std::size_t>(camera_.width_px)) / camera_.width_px;
      const double light = grey_[i] * (1 + paint_.light_gradient * (across - 0.5));
      const double sigma = std::hypot(paint_.read_noise, paint_.shot_noise * std::sqrt(std::max(light, 0.0)));
      bytes[i] = static_cast<std::uint8_t>(std::lround(std::clamp(light + sigma * random.normal(), 0.0, 255.0)));
    }
    return bytes;
  }

 private:
  std::size_t pixels() const { return static_cast<std::size_t>(camera_.width_px * camera_.height_px); }
  float& at(int x, int y) { return grey_[static_cast<std::size_t>(y * camera_.width_px + x)]; }

  /// Of the paper, which is one module wider than the black square on every side.
  std::array<int, 4> bounds(const PaintedMarker& marker) const {
    Eigen::Vector2d low(1e9, 1e9), high(-1e9, -1e9);
    for (int k = 0; k < 4; ++k) {
      const Eigen::Vector2d p = project(camera_, marker.T_camera_marker * marker_corner(marker.size_mm * 8 / 6, k));
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    }
    return {std::max(0, static_cast<int>(low.x()) - 2), std::max(0, static_cast<int>(low.y()) - 2),
            std::min(camera_.width_px - 1, static_cast<int>(high.x()) + 2),
            std::min(camera_.height_px - 1, static_cast<int>(high.y()) + 2)};
  }

  double grey_along(const Eigen::Isometry3d& T_marker_camera, double size_mm,
                    const std::array<std::uint8_t, 36>& modules, const Eigen::Vector2d& ray, double behind) const {
    const Eigen::Vector3d eye = T_marker_camera.translation();
    const Eigen::Vector3d direction = T_marker_camera.linear() * Eigen::Vector3d(ray.x(), ray.y(), 1);
    const Eigen::Vector3d hit = eye - direction * (eye.z() / direction.z());
    const double u = (hit.x() / size_mm + 0.5) * 6, v = (0.5 - hit.y() / size_mm) * 6;
    if (!(u >= -1 && u < 7 && v >= -1 && v < 7)) return behind;
    if (u < 0 || u >= 6 || v < 0 || v >= 6) return paint_.white;
    return modules[static_cast<std::size_t>(static_cast<int>(v) * 6 + static_cast<int>(u))] ? paint_.white
                                                                                            : paint_.black;
  }

  /// Along lines of `count` pixels, `step` apart; `lines` of them, `line_step` apart.
  void blur(int step, int count, int lines, int line_step) {
    if (paint_.blur_px <= 0) return;
    const int reach = static_cast<int>(std::ceil(3.5 * paint_.blur_px));
    std::vector<float> weights, line(static_cast<std::size_t>(count));
    double sum = 0;
    for (int i = -reach; i <= reach; ++i) sum += std::exp(-0.5 * i * i / (paint_.blur_px * paint_.blur_px));
    for (int i = -reach; i <= reach; ++i) {
      weights.push_back(static_cast<float>(std::exp(-0.5 * i * i / (paint_.blur_px * paint_.blur_px)) / sum));
    }
    for (int l = 0; l < lines; ++l) {
      float* first = grey_.data() + static_cast<std::ptrdiff_t>(l) * line_step;
      for (int i = 0; i < count; ++i) line[static_cast<std::size_t>(i)] = first[static_cast<std::ptrdiff_t>(i) * step];
      for (int i = 0; i < count; ++i) {
        float value = 0;
        for (int j = -reach; j <= reach; ++j) {
          value += weights[static_cast<std::size_t>(j + reach)] *
                   line[static_cast<std::size_t>(std::clamp(i + j, 0, count - 1))];
        }
        first[static_cast<std::ptrdiff_t>(i) * step] = value;
      }
    }
  }

  Lens camera_;
  Paint paint_;
  std::vector<float> grey_;
};

}  // namespace finsight::test
