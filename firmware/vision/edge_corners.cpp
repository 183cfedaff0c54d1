#include "firmware/vision/edge_corners.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "firmware/vision/grey_light.h"

namespace finsight {
namespace {

using Eigen::Vector2d;

constexpr int kRounds = 4;
// Profiles across each edge, spread over its middle part: near the corners the lens's blur rounds the edge off.
constexpr std::size_t kProfiles = 16, kMinProfiles = kProfiles / 2;
constexpr double kFirst = 0.10, kLast = 0.90;
constexpr float kStepPx = 0.5F;  // between the samples of a profile
// A profile reaches this many modules to either side, as the border and the margin are one module wide, but no further
// than kReachPx, which contains the blur and any error of the coarse corners.
constexpr float kModules = 6;  // along a side of the marker
constexpr float kReach = 0.55F, kReachPx = 6;
constexpr float kSmallestContrast = 10;                  // grey levels
constexpr double kOutlierMedians = 3, kOutlierPx = 0.1;  // distance from the line; three medians are two sigmas
// RMS distance of the points from their line: while the profiles are not yet centred on the edge, and at the end.
constexpr double kCoarseRmsPx = 2.0, kLargestRmsPx = 0.5;
constexpr float kFarthestMove = 0.25F;  // of a side

struct Line {
  Vector2d point = Vector2d::Zero(), normal = Vector2d::Zero();
  double end_variance_px2 = 0;  ///< across the line, at its ends
};

/// Points of one edge as rays (z = 1), at most one per profile.
struct EdgePoints {
  std::array<Vector2d, kProfiles> ray;
  std::size_t count = 0;
  double width_sq_px = 0;  ///< mean square of the distance of the rise from its middle
};

/// Along a profile, as shares of the reach.
struct Rise {
  float middle = 0;    ///< -1 ... 1
  float width_sq = 0;  ///< mean square of the distance from it
};

/// Where the light rises from ink to paper.
bool find_rise(const ImageView& image, const Vec2f& centre, const Vec2f& reach, int steps, Rise& found) {
  // The centroid of the rise, tapered towards the ends: noise and neighbouring modules count little there. What the
  // taper cuts off one side of the rise vanishes as the rounds centre the profile on it.
  const float step = 1.0F / static_cast<float>(steps);
  float before = 0, rise = 0, moment = 0, square = 0;
  for (int i = -steps; i <= steps; ++i) {
    const float at = static_cast<float>(i) * step;
    const float grey = light_of(image.sample(centre.x() + at * reach.x(), centre.y() + at * reach.y()), image.coding);
    if (i > -steps) {
      const float middle = at - step / 2;
      const float weighted = (1 - middle * middle) * (grey - before);
      rise += weighted;
      moment += weighted * middle;
      square += weighted * middle * middle;
    }
    before = grey;
  }
  if (!(rise > kSmallestContrast)) return false;
  found.middle = moment / rise;
  found.width_sq = square / rise - found.middle * found.middle;
  return std::abs(found.middle) < 1;
}

bool inside(const ImageView& image, const Vec2f& p) {
  return p.x() >= 0 && p.y() >= 0 && p.x() < static_cast<float>(image.width_px - 1) &&
         p.y() < static_cast<float>(image.height_px - 1);
}

/// How far to look across the edge from corner k to the next, in pixels: a share of a module as seen across this edge
/// (a tilted marker has narrow modules there).
float reach_across(const std::array<Vec2f, 4>& corners, std::size_t k) {
  const Vec2f a = corners[k], b = corners[(k + 1) % 4];
  const Vec2f inward = Vec2f(a.y() - b.y(), b.x() - a.x()).normalized();  // the corners run clockwise
  const float depth = inward.dot(corners[(k + 2) % 4] - b + corners[(k + 3) % 4] - a) / 2;
  return std::min(kReach * depth / kModules, kReachPx);
}

/// Follows the edge from ray a to ray b. Profiles are centred on the image of the straight line between them, which
/// the lens bends; what they find is small enough to be taken back along the slope of the projection.
void find_edge_points(const ImageView& image, const Lens& camera, const Vector2d& a, const Vector2d& b, float reach_px,
                      EdgePoints& points) {
  points.count = 0;
  points.width_sq_px = 0;
  if (!(reach_px > kStepPx)) return;
  const int steps = static_cast<int>(std::ceil(reach_px / kStepPx));
  for (std::size_t i = 0; i < kProfiles; ++i) {
    const Vector2d ray = a + (b - a) * (kFirst + (kLast - kFirst) * static_cast<double>(i) / (kProfiles - 1));
    const Projection centre = project_ray(camera, ray);
    const Vector2d along = centre.slope * (b - a);
    const Vector2d outward = Vector2d(along.y(), -along.x()).normalized();
    const Vec2f middle = centre.pixel.cast<float>(), reach = outward.cast<float>() * reach_px;
    Rise rise;
    if (!inside(image, middle - reach) || !inside(image, middle + reach) ||
        !find_rise(image, middle, reach, steps, rise)) {
      continue;
    }
    points.ray[points.count++] = ray + centre.slope.inverse() * outward * static_cast<double>(rise.middle * reach_px);
    points.width_sq_px += static_cast<double>(rise.width_sq * reach_px * reach_px);
  }
  if (points.count > 0) points.width_sq_px /= static_cast<double>(points.count);
}

/// Least squares of distances across the line; returns their RMS.
double fit_line(const EdgePoints& points, Line& line) {
  Vector2d mean = Vector2d::Zero();
  for (std::size_t i = 0; i < points.count; ++i) mean += points.ray[i];
  mean /= static_cast<double>(points.count);
  double xx = 0, xy = 0, yy = 0;
  for (std::size_t i = 0; i < points.count; ++i) {
    const Vector2d d = points.ray[i] - mean;
    xx += d.x() * d.x();
    xy += d.x() * d.y();
    yy += d.y() * d.y();
  }
  const double angle = 0.5 * std::atan2(2 * xy, xx - yy);
  line.point = mean;
  line.normal = Vector2d(-std::sin(angle), std::cos(angle));
  const Vector2d n = line.normal;
  return std::sqrt(std::max(0.0, n.x() * n.x() * xx + 2 * n.x() * n.y() * xy + n.y() * n.y() * yy) /
                   static_cast<double>(points.count));
}

/// A line that dirt on part of the edge does not bend: fit, leave out what lies far off, fit again. The median tells
/// what is far, because a few wild points would raise the mean above themselves.
bool fit_edge(EdgePoints& points, double px, double largest_rms_px, Line& line) {
  if (points.count < kMinProfiles) return false;
  fit_line(points, line);
  std::array<double, kProfiles> distance, sorted;
  for (std::size_t i = 0; i < points.count; ++i) distance[i] = std::abs(line.normal.dot(points.ray[i] - line.point));
  sorted = distance;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(points.count / 2);
  std::nth_element(sorted.begin(), middle, sorted.begin() + static_cast<std::ptrdiff_t>(points.count));
  const double far = std::max(kOutlierMedians * *middle, kOutlierPx * px);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < points.count; ++i) {
    if (distance[i] <= far) points.ray[kept++] = points.ray[i];
  }
  points.count = kept;
  if (kept < kMinProfiles) return false;
  const double rms = fit_line(points, line), count = static_cast<double>(kept);
  // At its ends a line that is fitted to evenly spread points varies twice as much as their mean.
  line.end_variance_px2 = 4 / (count - 2) * std::pow(rms / px, 2);
  return rms < largest_rms_px * px;
}

/// Not-a-number for parallel lines.
Vector2d crossing(const Line& first, const Line& second) {
  const double determinant = first.normal.x() * second.normal.y() - first.normal.y() * second.normal.x();
  const double a = first.normal.dot(first.point), b = second.normal.dot(second.point);
  return Vector2d(a * second.normal.y() - b * first.normal.y(), b * first.normal.x() - a * second.normal.x()) /
         determinant;
}

}  // namespace

std::optional<EdgeQuality> refine_corners(const ImageView& image, const Lens& camera,
                                          std::array<Vec2f, 4>& corners_px) {
  const double px = 1.0 / camera.fx;  // a pixel's size in the plane of the rays
  std::array<Vec2f, 4> corners = corners_px;
  std::array<Vector2d, 4> rays;
  for (std::size_t k = 0; k < 4; ++k) rays[k] = ray_from_pixel(camera, corners[k].cast<double>());
  EdgePoints points;
  std::array<Line, 4> lines;
  double variance = 0, width_sq = 0;
  for (int round = 0; round < kRounds; ++round) {
    variance = width_sq = 0;
    for (std::size_t k = 0; k < 4; ++k) {
      const float reach_px = reach_across(corners, k);
      const double largest_rms_px = round + 1 < kRounds ? kCoarseRmsPx : kLargestRmsPx;
      find_edge_points(image, camera, rays[k], rays[(k + 1) % 4], reach_px, points);
      if (!fit_edge(points, px, largest_rms_px, lines[k])) return std::nullopt;
      variance += lines[k].end_variance_px2 / 4;
      width_sq += points.width_sq_px / 4;
    }
    for (std::size_t k = 0; k < 4; ++k) {
      rays[k] = crossing(lines[(k + 3) % 4], lines[k]);
      corners[k] = pixel_from_ray(camera, rays[k]).cast<float>();
      const float side = (corners_px[(k + 1) % 4] - corners_px[k]).norm();
      if (!((corners[k] - corners_px[k]).norm() < kFarthestMove * side)) return std::nullopt;
    }
  }
  corners_px = corners;
  return EdgeQuality{static_cast<float>(std::sqrt(variance)), static_cast<float>(std::sqrt(std::max(0.0, width_sq)))};
}

}  // namespace finsight
