#include "firmware/geometry/lens.h"

#include <Eigen/LU>
#include <cmath>
#include <limits>

#include "firmware/input_error.h"

namespace finsight {
namespace {

using Eigen::Vector2d;

void require(bool holds, const char* field, double found, const char* expected) {
  if (!holds) throw InputError("camera", field, std::to_string(found), expected);
}

}  // namespace

void check_camera(const CameraModel& camera) {
  require(camera.width_px >= 16 && camera.width_px <= 8192, "width_px", camera.width_px, "16 ... 8192");
  require(camera.height_px >= 16 && camera.height_px <= 8192, "height_px", camera.height_px, "16 ... 8192");
  // Comparisons with a NaN are false, so these also refuse what is not a number.
  require(camera.fx > 0 && camera.fx < 1e5F, "fx", camera.fx, "a positive number of pixels");
  require(camera.fy > 0 && camera.fy < 1e5F, "fy", camera.fy, "a positive number of pixels");
  require(camera.cx >= 0 && camera.cx < static_cast<float>(camera.width_px), "cx", camera.cx, "inside the image");
  require(camera.cy >= 0 && camera.cy < static_cast<float>(camera.height_px), "cy", camera.cy, "inside the image");
  const float coefficients[] = {camera.k1, camera.k2, camera.p1, camera.p2, camera.k3};
  const char* const names[] = {"k1", "k2", "p1", "p2", "k3"};
  for (int i = 0; i < 5; ++i) require(std::isfinite(coefficients[i]), names[i], coefficients[i], "a finite number");
}

Projection project_ray(const CameraModel& camera, const Vector2d& ray) {
  const double k1 = camera.k1, k2 = camera.k2, k3 = camera.k3, p1 = camera.p1, p2 = camera.p2;
  const double x = ray.x(), y = ray.y(), r2 = ray.squaredNorm();
  const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  const double radial_slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3));  // d radial / d x = radial_slope * x
  const double mixed = radial_slope * x * y + 2 * p1 * x + 2 * p2 * y;
  Projection p;
  p.pixel << camera.fx * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + camera.cx,
      camera.fy * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + camera.cy;
  p.slope << camera.fx * (radial + radial_slope * x * x + 2 * p1 * y + 6 * p2 * x), camera.fx * mixed,
      camera.fy * mixed, camera.fy * (radial + radial_slope * y * y + 6 * p1 * y + 2 * p2 * x);
  return p;
}

Vector2d pixel_from_ray(const CameraModel& camera, const Vector2d& ray) { return project_ray(camera, ray).pixel; }

Vector2d ray_from_pixel(const CameraModel& camera, const Vector2d& pixel) {
  // Newton from the undistorted position: four steps suffice everywhere in an image that the lens model fits; the
  // others are for its corners. A slope that is no longer positive means that the model has folded over.
  constexpr int kSteps = 12;
  constexpr double kTolerancePx = 1e-6;
  Vector2d ray((pixel.x() - camera.cx) / camera.fx, (pixel.y() - camera.cy) / camera.fy);
  for (int step = 0; step < kSteps; ++step) {
    const Projection p = project_ray(camera, ray);
    const Vector2d error = p.pixel - pixel;
    if (!(p.slope.determinant() > 0) || !(p.slope.trace() > 0)) break;
    if (error.norm() < kTolerancePx) return ray;
    ray -= p.slope.inverse() * error;
  }
  return Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
}

}  // namespace finsight
