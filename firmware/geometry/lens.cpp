#include "firmware/geometry/lens.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "firmware/input_error.h"

namespace finsight {
namespace {

using Eigen::Vector2d;

void require(bool holds, const char* field, double found, const char* expected) {
  if (!holds) throw InputError("lens", field, std::to_string(found), expected);
}

}  // namespace

Lens in_single_precision(const Lens& lens) {
  LensNumbers numbers = lens_numbers(lens);
  for (double& number : numbers) number = static_cast<float>(number);
  return make_lens(lens.width_px, lens.height_px, numbers);
}

void check_lens(const Lens& lens) {
  require(lens.width_px >= 16 && lens.width_px <= 8192, "width_px", lens.width_px, "16 ... 8192");
  require(lens.height_px >= 16 && lens.height_px <= 8192, "height_px", lens.height_px, "16 ... 8192");
  check_lens_numbers(lens);
}

void check_lens_numbers(const Lens& lens) {
  // Comparisons with a NaN are false, so these also refuse what is not a number.
  const double side_px = std::max(lens.width_px, lens.height_px);
  const auto is_plausible = [&](double focal_px) {
    return focal_px >= kShortestFocal * side_px && focal_px <= kLongestFocal * side_px;
  };
  constexpr const char* kFocal = "0.1 to 20 times the image's longer side, in pixels";
  require(is_plausible(lens.fx), "fx", lens.fx, kFocal);
  require(is_plausible(lens.fy), "fy", lens.fy, kFocal);
  require(lens.cx >= 0 && lens.cx < lens.width_px, "cx", lens.cx, "inside the image");
  require(lens.cy >= 0 && lens.cy < lens.height_px, "cy", lens.cy, "inside the image");
  const LensNumbers numbers = lens_numbers(lens);
  for (std::size_t i = 4; i < kLensNumbers; ++i) {
    require(std::isfinite(numbers[i]), kLensNames[i], numbers[i], "a finite number");
  }
}

Projection project_ray(const Lens& lens, const Vector2d& ray) {
  const double k1 = lens.k1, k2 = lens.k2, k3 = lens.k3, p1 = lens.p1, p2 = lens.p2;
  const double x = ray.x(), y = ray.y(), r2 = ray.squaredNorm();
  const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  const double radial_slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3));  // d radial / d x = radial_slope * x
  const double mixed = radial_slope * x * y + 2 * p1 * x + 2 * p2 * y;
  Projection p;
  p.pixel << lens.fx * (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) + lens.cx,
      lens.fy * (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) + lens.cy;
  p.slope << lens.fx * (radial + radial_slope * x * x + 2 * p1 * y + 6 * p2 * x), lens.fx * mixed,  //
      lens.fy * mixed, lens.fy * (radial + radial_slope * y * y + 6 * p1 * y + 2 * p2 * x);
  return p;
}

Vector2d pixel_from_ray(const Lens& lens, const Vector2d& ray) { return project_ray(lens, ray).pixel; }

Vector2d ray_from_pixel(const Lens& lens, const Vector2d& pixel, double tolerance_px) {
  // Newton from the undistorted position: four steps suffice everywhere in an image that the lens model fits; the
  // others are for its corners. A slope that is no longer positive means that the model has folded over.
  constexpr int kSteps = 30;
  Vector2d ray((pixel.x() - lens.cx) / lens.fx, (pixel.y() - lens.cy) / lens.fy);
  for (int step = 0; step < kSteps; ++step) {
    const Projection p = project_ray(lens, ray);
    const Vector2d error = p.pixel - pixel;
    if (!(p.slope.determinant() > 0) || !(p.slope.trace() > 0)) break;
    if (error.norm() < tolerance_px) return ray;
    ray -= p.slope.inverse() * error;
  }
  return Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
}

double turning_radius_sq(const Lens& lens) {
  // The derivative of r (1 + k1 r^2 + k2 r^4 + k3 r^6) is a cubic in s = r^2; its first root is looked for.
  constexpr double kWidest = 100, kStep = 1e-4;
  for (double s = 0; s < kWidest; s += kStep) {
    if (1 + s * (3 * lens.k1 + s * (5 * lens.k2 + s * 7 * lens.k3)) <= 0) return s;
  }
  return kWidest;
}

}  // namespace finsight
