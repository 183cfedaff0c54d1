#include "hostgen/render/lens.h"

#include <limits>

namespace finsight::host {

namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;

/// Brown-Conrady: the distorted point of a ray, and its derivative.
Vector2d distorted(const CameraIntrinsics& c, const Vector2d& ray, Matrix2d* derivative = nullptr) {
  const double x = ray.x(), y = ray.y(), s = ray.squaredNorm();
  const double radial = 1 + s * (c.k1 + s * (c.k2 + s * c.k3));
  if (derivative) {
    const double slope = 2 * (c.k1 + s * (2 * c.k2 + s * 3 * c.k3));  // twice the derivative of `radial` by s
    const double mixed = slope * x * y + 2 * c.p1 * x + 2 * c.p2 * y;
    *derivative << radial + slope * x * x + 2 * c.p1 * y + 6 * c.p2 * x, mixed,  //
        mixed, radial + slope * y * y + 6 * c.p1 * y + 2 * c.p2 * x;
  }
  return {x * radial + 2 * c.p1 * x * y + c.p2 * (s + 2 * x * x),
          y * radial + c.p1 * (s + 2 * y * y) + 2 * c.p2 * x * y};
}

/// The squared radius where r (1 + k1 r^2 + k2 r^4 + k3 r^6) stops growing; a bound of 84 degrees off the axis if
/// never.
double turning_radius_sq(const CameraIntrinsics& c) {
  constexpr double kWidest = 100, kStep = 1e-4;
  for (double s = 0; s < kWidest; s += kStep) {
    if (1 + s * (3 * c.k1 + s * (5 * c.k2 + s * 7 * c.k3)) <= 0) return s;
  }
  return kWidest;
}

}  // namespace

Lens::Lens(const CameraIntrinsics& camera) : camera_(camera), max_radius_sq_(turning_radius_sq(camera)) {}

std::optional<Vector2d> Lens::pixel(const Vector2d& ray) const {
  if (!(ray.squaredNorm() < max_radius_sq_)) return std::nullopt;
  const Vector2d point = distorted(camera_, ray);
  return Vector2d(camera_.fx * point.x() + camera_.cx, camera_.fy * point.y() + camera_.cy);
}

std::optional<Vector2d> Lens::ray(const Vector2d& pixel) const {
  const Vector2d point((pixel.x() - camera_.cx) / camera_.fx, (pixel.y() - camera_.cy) / camera_.fy);
  // Newton from the distorted point. Lenses of this kind compress more and more outwards (the polynomial is concave up
  // to its turning point), so the iterates come from inside and never jump over it.
  Vector2d ray = point;
  Matrix2d derivative;
  for (int iteration = 0; iteration < 30; ++iteration) {
    const Vector2d residual = point - distorted(camera_, ray, &derivative);
    if (residual.lpNorm<Eigen::Infinity>() < 1e-12) break;
    ray += derivative.inverse() * residual;
    if (!(ray.squaredNorm() < max_radius_sq_)) return std::nullopt;
  }
  if ((point - distorted(camera_, ray)).lpNorm<Eigen::Infinity>() > 1e-9) return std::nullopt;
  return ray;
}

CameraModel camera_model(const CameraIntrinsics& c) {
  const auto f = [](double value) { return static_cast<float>(value); };
  return {c.width_px, c.height_px, f(c.fx), f(c.fy), f(c.cx), f(c.cy), f(c.k1), f(c.k2), f(c.p1), f(c.p2), f(c.k3)};
}

}  // namespace finsight::host
