#include "tests/vision/marker_painter.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "firmware/vision/aruco_compat.h"
#include "tests/random.h"

namespace finsight::test {

Eigen::Vector3d marker_corner(double size_mm, int k) {
  return {(k == 1 || k == 2 ? 0.5 : -0.5) * size_mm, (k < 2 ? 0.5 : -0.5) * size_mm, 0};
}

Eigen::Vector2d project(const Lens& camera, const Eigen::Vector3d& point_mm) {
  return pixel_from_ray(camera, point_mm.head<2>() / point_mm.z());
}

std::array<Vec2f, 4> true_corners(const Lens& camera, const PaintedMarker& marker) {
  std::array<Vec2f, 4> corners;
  for (int k = 0; k < 4; ++k) {
    corners[static_cast<std::size_t>(k)] =
        project(camera, marker.T_camera_marker * marker_corner(marker.size_mm, k)).cast<float>();
  }
  return corners;
}

Image::Image(const Lens& camera, const Paint& paint)
    : camera_(camera),
      paint_(paint),
      grey_(static_cast<std::size_t>(camera.width_px * camera.height_px), static_cast<float>(paint.background)) {}

void Image::add(const PaintedMarker& marker) { add(marker, marker_modules(marker.id)); }

void Image::add(const PaintedMarker& marker, const std::array<std::uint8_t, 36>& modules) {
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

std::vector<std::uint8_t> Image::develop(std::uint64_t seed) {
  blur(1, camera_.width_px, camera_.height_px, camera_.width_px);
  blur(camera_.width_px, camera_.height_px, camera_.width_px, 1);
  Random random(seed);
  std::vector<std::uint8_t> bytes(grey_.size());
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    const double across = static_cast<double>(i % static_cast<std::size_t>(camera_.width_px)) / camera_.width_px;
    const double light = grey_[i] * (1 + paint_.light_gradient * (across - 0.5));
    const double sigma = std::hypot(paint_.read_noise, paint_.shot_noise * std::sqrt(std::max(light, 0.0)));
    bytes[i] = static_cast<std::uint8_t>(std::lround(std::clamp(light + sigma * random.normal(), 0.0, 255.0)));
  }
  return bytes;
}

std::array<int, 4> Image::bounds(const PaintedMarker& marker) const {
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

double Image::grey_along(const Eigen::Isometry3d& T_marker_camera, double size_mm,
                         const std::array<std::uint8_t, 36>& modules, const Eigen::Vector2d& ray, double behind) const {
  const Eigen::Vector3d eye = T_marker_camera.translation();
  const Eigen::Vector3d direction = T_marker_camera.linear() * Eigen::Vector3d(ray.x(), ray.y(), 1);
  const Eigen::Vector3d hit = eye - direction * (eye.z() / direction.z());
  const double u = (hit.x() / size_mm + 0.5) * 6, v = (0.5 - hit.y() / size_mm) * 6;
  if (!(u >= -1 && u < 7 && v >= -1 && v < 7)) return behind;
  if (u < 0 || u >= 6 || v < 0 || v >= 6) return paint_.white;
  return modules[static_cast<std::size_t>(static_cast<int>(v) * 6 + static_cast<int>(u))] ? paint_.white : paint_.black;
}

void Image::blur(int step, int count, int lines, int line_step) {
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

}  // namespace finsight::test
