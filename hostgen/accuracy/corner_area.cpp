// Errors of corners in rendered images: the firmware's edge fit beside OpenCV's cornerSubPix.
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>

#include "firmware/vision/edge_corners.h"
#include "firmware/vision/ippe.h"
#include "hostgen/accuracy/areas.h"
#include "hostgen/finger/plate_motion.h"
#include "hostgen/render/renderer.h"
#include "hostgen/util/common.h"

namespace finsight::host {

using nlohmann::json;

namespace {

constexpr std::uint64_t kCornerSeed = 77;
constexpr double kCoarsePx = 1.5;  // error of a detector's corners, from whole pixels and blur
using Corners = std::array<Vec2f, 4>;

/// Errors of one method under one condition.
struct CornerErrors {
  std::size_t corners = 0, lost = 0;
  double outward_px = 0, squares = 0;

  void add(const Corners& found, const Corners& truth) {
    const Vec2f centre = (truth[0] + truth[1] + truth[2] + truth[3]) / 4;
    for (std::size_t k = 0; k < 4; ++k) {
      const Vec2f error = found[k] - truth[k];
      outward_px += static_cast<double>(error.dot((truth[k] - centre).normalized()));
      squares += static_cast<double>(error.squaredNorm());
      ++corners;
    }
  }
  void put(json& row, const std::string& method) const {
    const double count = static_cast<double>(corners);
    row[method + "_bias_px"] = corners ? json(outward_px / count) : json();
    row[method + "_rms_px"] = corners ? json(std::sqrt(squares / (2 * count))) : json();
  }
};

/// One marker as it was rendered.
struct DrawnMarker {
  Corners truth;
  double distance_mm = 0, tilt_deg = 0;
};

DrawnMarker drawn(const FingerSpec& spec, const Lens& lens, std::size_t plate, const PlateMotion& motion) {
  const Eigen::Isometry3d pose = T_camera_marker(spec, plate, motion);
  DrawnMarker marker;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d corner = pose * marker_corner(spec.marker_size_mm, k);
    marker.truth[k] = pixel_from_ray(lens, corner.head<2>() / corner.z()).cast<float>();
  }
  const Eigen::Vector3d centre = pose.translation();
  marker.distance_mm = centre.norm();
  marker.tilt_deg = std::acos(std::abs(pose.linear().col(2).dot(centre.normalized()))) * 180 / std::numbers::pi;
  return marker;
}

/// Plates pushed inwards and rotated at random, a little further than touches rotate them.
std::array<PlateMotion, kPlates> random_motions(Random& random) {
  std::array<PlateMotion, kPlates> motions;
  for (PlateMotion& motion : motions) {
    motion.displacement_mm =
        Eigen::Vector3d(random.uniform(-2, 2), random.uniform(-3, 1), random.uniform(0, 8)).cast<float>();
    motion.rotation_rad =
        Eigen::Vector3d(random.uniform(-0.25, 0.25), random.uniform(-0.2, 0.2), random.uniform(-0.15, 0.15))
            .cast<float>();
  }
  return motions;
}

Corners by_corner_sub_pix(const ImageView& image, const Corners& start) {
  std::vector<cv::Point2f> points;
  for (const Vec2f& corner : start) points.emplace_back(corner.x(), corner.y());
  const cv::Mat grey(image.height_px, image.width_px, CV_8UC1, const_cast<std::uint8_t*>(image.pixels));
  cv::cornerSubPix(grey, points, {4, 4}, {-1, -1}, {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 40, 0.01});
  Corners corners;
  for (std::size_t k = 0; k < 4; ++k) corners[k] = {points[k].x, points[k].y};
  return corners;
}

/// Renders `images` images of `quality` and calls `take` with each marker and the corners that both methods find.
using Take = std::function<void(const DrawnMarker&, const Corners* edges, const Corners& sub_pix)>;
void measure(const FingerSpec& spec, const ImageQuality& quality, int images, const Take& take) {
  const Lens& lens = spec.cameras[0];
  Renderer renderer(spec, lens, quality, kCornerSeed);
  Random random(kCornerSeed);
  std::vector<std::uint8_t> grey;
  for (int n = 0; n < images; ++n) {
    if (interrupted()) throw Interrupted();
    const std::array<PlateMotion, kPlates> motions = random_motions(random);
    renderer.render(motions, grey);
    const ImageView image{grey.data(), lens.width_px, lens.height_px, lens.width_px,
                          quality.srgb ? Coding::kSrgb : Coding::kLinear};
    for (std::size_t p = 0; p < kPlates; ++p) {
      const DrawnMarker marker = drawn(spec, lens, p, motions[p]);
      Corners coarse = marker.truth;
      for (Vec2f& corner : coarse) {
        const double angle = random.uniform(-std::numbers::pi, std::numbers::pi);
        corner += (kCoarsePx * Eigen::Vector2d(std::cos(angle), std::sin(angle))).cast<float>();
      }
      Corners edges = coarse;
      const bool found = refine_corners(image, lens, edges).has_value();
      take(marker, found ? &edges : nullptr, by_corner_sub_pix(image, coarse));
    }
  }
}

struct Row {
  CornerErrors edges, sub_pix;
  void add(const DrawnMarker& marker, const Corners* by_edges, const Corners& by_sub_pix) {
    if (by_edges) edges.add(*by_edges, marker.truth);
    edges.lost += by_edges == nullptr;
    sub_pix.add(by_sub_pix, marker.truth);
  }
  json figures(const std::string& varied, const json& value) const {
    json row{{"varied", varied}, {"value", value}, {"corners", sub_pix.corners}, {"markers_lost", edges.lost}};
    edges.put(row, "edges");
    sub_pix.put(row, "sub_pix");
    return row;
  }
};

/// Distance and tilt: one set of images, sorted.
void add_by_pose(const FingerSpec& spec, int images, json& rows) {
  constexpr double kFar_mm[] = {0, 70, 95, 1000}, kSteep_deg[] = {0, 6, 12, 90};
  std::array<Row, 3> by_distance, by_tilt;
  const auto place = [](const double(&edges)[4], double value) {
    return value < edges[1] ? 0U : value < edges[2] ? 1U : 2U;
  };
  measure(spec, image_preset("lab"), 2 * images,
          [&](const DrawnMarker& marker, const Corners* edges, const Corners& other) {
            by_distance[place(kFar_mm, marker.distance_mm)].add(marker, edges, other);
            by_tilt[place(kSteep_deg, marker.tilt_deg)].add(marker, edges, other);
          });
  for (std::size_t i = 0; i < 3; ++i) rows.push_back(by_distance[i].figures("distance_from_mm", kFar_mm[i]));
  for (std::size_t i = 0; i < 3; ++i) rows.push_back(by_tilt[i].figures("tilt_from_deg", kSteep_deg[i]));
}

}  // namespace

json measure_corners(const FingerSpec& spec, bool quick) {
  const int images = quick ? 3 : 40;
  const ImageQuality lab = image_preset("lab");
  struct Condition {
    std::string varied;
    json value;
    ImageQuality quality;
  };
  std::vector<Condition> conditions;
  const auto vary = [&](const std::string& name, double ImageQuality::*field, std::initializer_list<double> values) {
    for (const double value : values) {
      conditions.push_back({name, value, lab});
      conditions.back().quality.*field = value;
    }
  };
  vary("blur_px", &ImageQuality::blur_px, {0.4, 0.7, 1.0, 1.5});
  vary("read_noise", &ImageQuality::read_noise, {0.5, 3, 6, 10});
  vary("light_gradient", &ImageQuality::light_gradient, {0, 0.6});
  for (const double light : {1.0, 0.5, 0.25}) {
    conditions.push_back({"light", light, lab});
    ImageQuality& quality = conditions.back().quality;
    for (double ImageQuality::*grey :
         {&ImageQuality::white, &ImageQuality::black, &ImageQuality::plate, &ImageQuality::background}) {
      quality.*grey *= light;
    }
  }
  for (const int jpeg_quality : {60, 75, 90}) {
    conditions.push_back({"jpeg_quality", jpeg_quality, lab});
    conditions.back().quality.jpeg_quality = jpeg_quality;
  }
  for (const std::string& preset : image_presets()) conditions.push_back({"preset", preset, image_preset(preset)});

  json rows = json::array();
  Progress progress("corners", conditions.size() + 1);
  add_by_pose(spec, images, rows);
  progress.advance();
  for (const Condition& condition : conditions) {
    Row row;
    measure(
        spec, condition.quality, images,
        [&](const DrawnMarker& marker, const Corners* edges, const Corners& other) { row.add(marker, edges, other); });
    rows.push_back(row.figures(condition.varied, condition.value));
    progress.advance();
  }
  return rows;
}

}  // namespace finsight::host
