#include "firmware/vision/edge_corners.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "firmware/vision/grey_light.h"

namespace finsight {
namespace {

using Eigen::Vector2d;

constexpr int kRounds = 4, kRoundsToCentre = 2, kRoundsOfCutOff = 3;
// Profiles across each edge, spread over its middle part: near the corners the lens's blur rounds the edge off.
constexpr std::size_t kProfiles = 16, kMinProfiles = kProfiles / 2;
constexpr double kFirst = 0.10, kLast = 0.90;
constexpr float kStepPx = 0.5F;  // between the samples of a profile
// A profile reaches this many modules to either side, as the border and the margin are one module wide, but no further
// than kReachPx, which contains the blur and any error of the coarse corners.
constexpr float kModules = 6;  // along a side of the marker
constexpr float kReach = 0.55F, kReachPx = 6;
constexpr float kCutOffGrey = 253;       // grey levels; brighter ones may be cut off
constexpr float kSmallestContrast = 10;  // grey levels
// An edge whose profiles differ by more than this share of their rise lies in glare; one that rises by less than this
// share of what most of them do is cut off by the brightest grey.
constexpr float kGlare = 0.15F, kSmallestRise = 0.8F;
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
  std::array<Vector2d, kProfiles> ray_in_glare;  ///< the same points, by Rise::middle_in_glare
  std::array<float, kProfiles> rise, level;      ///< of each, grey levels
  std::array<bool, kProfiles> is_cut_off;        ///< whether the paper is brighter than the picture can show
  std::size_t count = 0;
  double width_sq_px = 0;  ///< mean square of the distance of the rise from its middle
};

/// Along a profile, as shares of the reach.
struct Rise {
  float middle = 0;           ///< -1 ... 1
  float middle_in_glare = 0;  ///< the same where the light that is reflected besides is curved along the profile
  float height = 0;           ///< grey levels
  float level = 0;            ///< mean, grey levels
  bool is_cut_off = false;    ///< whether the brightest grey hides how high it is
  float width_sq = 0;         ///< mean square of the distance from it
};

/// Where the light rises from ink to paper.
bool find_rise(const ImageView& image, const Vec2f& centre, const Vec2f& reach, int steps, Rise& found) {
  // The centroid of the rise, tapered towards the ends: noise and neighbouring modules count little there. What the
  // taper cuts off one side of the rise vanishes as the rounds centre the profile on it.
  const float step = 1.0F / static_cast<float>(steps);
  float before = 0, rise = 0, moment = 0, moment_in_glare = 0, square = 0, sum = 0, brightest = 0;
  for (int i = -steps; i <= steps; ++i) {
    const float at = static_cast<float>(i) * step;
    const float coded = image.sample(centre.x() + at * reach.x(), centre.y() + at * reach.y());
    const float grey = light_of(coded, image.coding);
    brightest = std::max(brightest, coded);
    sum += grey;
    if (i > -steps) {
      const float middle = at - step / 2;
      const float weighted = (1 - middle * middle) * (grey - before);
      rise += weighted;
      moment += weighted * middle;
      moment_in_glare += weighted * middle * (1 - 7 * middle * middle / 3);
      square += weighted * middle * middle;
    }
    before = grey;
  }
  if (!(rise > kSmallestContrast)) return false;
  found.middle = moment / rise;
  // This moment of m^2, as of anything even, is 0, too, so that a highlight's curvature does not move the edge.
  found.middle_in_glare = moment_in_glare / rise;
  found.height = rise;
  found.is_cut_off = brightest > kCutOffGrey;
  found.level = sum / static_cast<float>(2 * steps + 1);
  found.width_sq = square / rise - found.middle * found.middle;
  return std::abs(found.middle) < 1;
}

/// Of an edge, the mean over its profiles.
struct EdgeRise {
  float height = 0;    ///< grey levels
  float width_px = 0;  ///< standard deviation
  bool is_cut_off = false;
};

/// Where the light rises from ink to paper that is brighter than the picture can show: the ink, which the glare
/// brightens, too, is followed from the profile's inner end up to where the light is three tenths of the full rise
/// above it.
bool find_foot(const ImageView& image, const Vec2f& centre, const Vec2f& reach, int steps, const EdgeRise& full,
               Rise& found) {
  constexpr float kFoot = 0.3F, kFootSigmas = 0.524F;  // the normal distribution's value there, below its middle
  const int ink = steps / 2 + 1;                       // samples that are taken for ink: the inner quarter
  const float step = 1.0F / static_cast<float>(steps);
  const float middle = static_cast<float>(ink - 1) / 2;
  float mean = 0, slope = 0, norm = 0, above_before = 0;
  const auto light_at = [&](int i) {
    const float at = -1 + static_cast<float>(i) * step;
    return light_of(image.sample(centre.x() + at * reach.x(), centre.y() + at * reach.y()), image.coding);
  };
  for (int i = 0; i < ink; ++i) {
    const float off = static_cast<float>(i) - middle, light = light_at(i);
    mean += light / static_cast<float>(ink);
    slope += off * light;
    norm += off * off;
  }
  slope = norm > 0 ? slope / norm : 0;
  for (int i = ink; i <= 2 * steps; ++i) {
    const float above = light_at(i) - (mean + slope * (static_cast<float>(i) - middle)) - kFoot * full.height;
    if (above >= 0) {
      const float share = above_before < 0 ? above_before / (above_before - above) : 0;
      found.middle = -1 + (static_cast<float>(i - 1) + share) * step + kFootSigmas * full.width_px / reach.norm();
      found.middle_in_glare = found.middle;
      found.height = full.height;
      found.level = 0;
      found.is_cut_off = true;
      found.width_sq = full.width_px * full.width_px / reach.squaredNorm();
      return std::abs(found.middle) < 1;
    }
    above_before = above;
  }
  return false;
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
                      const EdgeRise* cut_off, EdgePoints& points) {
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
        !(cut_off ? find_foot(image, middle, reach, steps, *cut_off, rise)
                  : find_rise(image, middle, reach, steps, rise))) {
      continue;
    }
    points.rise[points.count] = rise.height;
    points.level[points.count] = rise.level;
    points.is_cut_off[points.count] = rise.is_cut_off;
    const Vector2d outward_ray = centre.slope.inverse() * outward * static_cast<double>(reach_px);
    points.ray_in_glare[points.count] = ray + outward_ray * static_cast<double>(rise.middle_in_glare);
    points.ray[points.count++] = ray + outward_ray * static_cast<double>(rise.middle);
    points.width_sq_px += static_cast<double>(rise.width_sq * reach_px * reach_px);
  }
  if (points.count > 0) points.width_sq_px /= static_cast<double>(points.count);
}

EdgeRise rise_of(const EdgePoints& points) {
  EdgeRise rise;
  std::size_t cut_off = 0;
  for (std::size_t i = 0; i < points.count; ++i) {
    rise.height += points.rise[i] / static_cast<float>(points.count);
    cut_off += points.is_cut_off[i];
  }
  rise.width_px = static_cast<float>(std::sqrt(std::max(0.0, points.width_sq_px)));
  rise.is_cut_off = cut_off > points.count / 4;
  return rise;
}

/// Where shining ink and paper make some of an edge's profiles brighter than others: takes the points that the glare's
/// curvature does not move, and leaves out the profiles whose paper is brighter than the picture can show, if enough
/// are left.
void see_through_glare(EdgePoints& points) {
  if (points.count == 0) return;
  std::array<float, kProfiles> sorted = points.rise;
  const auto most = sorted.begin() + static_cast<std::ptrdiff_t>(points.count * 3 / 4);
  std::nth_element(sorted.begin(), most, sorted.begin() + static_cast<std::ptrdiff_t>(points.count));
  const auto end = points.level.begin() + static_cast<std::ptrdiff_t>(points.count);
  const auto [darkest, brightest] = std::minmax_element(points.level.begin(), end);
  if (*brightest - *darkest < kGlare * *most) return;
  points.ray = points.ray_in_glare;
  const auto rises = [&](std::size_t i) { return points.rise[i] >= kSmallestRise * *most; };
  std::size_t kept = 0;
  for (std::size_t i = 0; i < points.count; ++i) kept += rises(i);
  if (kept < kMinProfiles) return;
  kept = 0;
  for (std::size_t i = 0; i < points.count; ++i) {
    if (rises(i)) points.ray[kept++] = points.ray[i];
  }
  points.count = kept;
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

/// A marker's outline on the way from the coarse corners to the edges.
struct Outline {
  std::array<Vec2f, 4> corners_px;
  std::array<Vector2d, 4> rays;
  std::array<EdgeRise, 4> rises;
  double variance_px2 = 0, width_sq_px = 0;
};

/// How one round follows the edges.
struct Round {
  bool is_centred = false;
  double largest_rms_px = kCoarseRmsPx;
  const EdgeRise* full = nullptr;  ///< for edges that are cut off, once that is known
};

/// One round: follows the four edges and cuts the lines; false if one cannot be followed, or a corner ends up
/// elsewhere.
bool follow_edges(const ImageView& image, const Lens& camera, const std::array<Vec2f, 4>& coarse_px, const Round& how,
                  Outline& outline) {
  const double px = 1.0 / camera.fx;  // a pixel's size in the plane of the rays
  auto& [corners, rays, rises, variance, width_sq] = outline;
  EdgePoints points;
  std::array<Line, 4> lines;
  variance = width_sq = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    const EdgeRise* cut_off = rises[k].is_cut_off ? how.full : nullptr;
    find_edge_points(image, camera, rays[k], rays[(k + 1) % 4], reach_across(corners, k), cut_off, points);
    rises[k] = rise_of(points);
    if (how.is_centred) see_through_glare(points);
    if (!fit_edge(points, px, how.largest_rms_px, lines[k])) return false;
    variance += lines[k].end_variance_px2 / 4;
    width_sq += points.width_sq_px / 4;
  }
  for (std::size_t k = 0; k < 4; ++k) {
    rays[k] = crossing(lines[(k + 3) % 4], lines[k]);
    corners[k] = pixel_from_ray(camera, rays[k]).cast<float>();
    const float side = (coarse_px[(k + 1) % 4] - coarse_px[k]).norm();
    if (!((corners[k] - coarse_px[k]).norm() < kFarthestMove * side)) return false;
  }
  return true;
}

/// Follows once more an outline some of whose edges are cut off, if others show how far light rises here.
void mend_cut_off(const ImageView& image, const Lens& camera, const std::array<Vec2f, 4>& coarse_px, Outline& outline) {
  const auto height = [](const EdgeRise& rise) { return rise.is_cut_off ? 0 : rise.height; };
  const EdgeRise full = *std::ranges::max_element(outline.rises, {}, height);
  if (full.is_cut_off || std::ranges::none_of(outline.rises, &EdgeRise::is_cut_off)) return;
  Outline mended = outline;
  for (int round = 0; round < kRoundsOfCutOff; ++round) {
    if (!follow_edges(image, camera, coarse_px, {true, kLargestRmsPx, &full}, mended)) return;
  }
  outline = mended;
}

}  // namespace

std::optional<EdgeQuality> refine_corners(const ImageView& image, const Lens& camera,
                                          std::array<Vec2f, 4>& corners_px) {
  Outline outline{.corners_px = corners_px, .rays = {}, .rises = {}};
  for (std::size_t k = 0; k < 4; ++k) outline.rays[k] = ray_from_pixel(camera, corners_px[k].cast<double>());
  for (int round = 0; round < kRounds; ++round) {
    const Round how{round >= kRoundsToCentre, round + 1 < kRounds ? kCoarseRmsPx : kLargestRmsPx};
    if (!follow_edges(image, camera, corners_px, how, outline)) return std::nullopt;
  }
  mend_cut_off(image, camera, corners_px, outline);
  corners_px = outline.corners_px;
  return EdgeQuality{static_cast<float>(std::sqrt(outline.variance_px2)),
                     static_cast<float>(std::sqrt(std::max(0.0, outline.width_sq_px)))};
}

}  // namespace finsight
