#include "hostgen/render/figure.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>

#include "hostgen/finger/mesh.h"

namespace finsight::host {

namespace {

// Everything is drawn this much larger and then reduced: smooth edges without seams between triangles.
constexpr int kOversampling = 3;
constexpr double kImageWidth_px = 600;  // the left part of the figure
const cv::Scalar kInk(40, 40, 40), kShadow(225, 225, 225), kFound(60, 200, 90), kTouched(214, 39, 40);  // RGB

using Vec2d = Eigen::Vector2d;
using Vec3d = Eigen::Vector3d;
using Triangle = std::array<int, 3>;

/// Draws in pixels of the finished figure.
class Canvas {
 public:
  Canvas()
      : pixels_(kFigureHeight_px * kOversampling, kFigureWidth_px * kOversampling, CV_8UC3, cv::Scalar::all(255)) {}

  void line(const Vec2d& from, const Vec2d& to, const cv::Scalar& colour, double width_px) {
    cv::line(pixels_, fixed(from), fixed(to), colour, thickness(width_px), cv::LINE_AA, kShift);
  }
  void outline(const std::vector<Vec2d>& points, const cv::Scalar& colour, double width_px) {
    for (std::size_t i = 0; i < points.size(); ++i) line(points[i], points[(i + 1) % points.size()], colour, width_px);
  }
  void fill(const std::vector<Vec2d>& points, const cv::Scalar& colour) {
    std::vector<cv::Point> corners;
    for (const Vec2d& point : points) corners.push_back(fixed(point));
    cv::fillConvexPoly(pixels_, corners, colour, cv::LINE_8, kShift);
  }
  /// `at`: the left end of the text's base line.
  void text(const std::string& words, const Vec2d& at, const cv::Scalar& colour, double height_px = 17) {
    constexpr double kFontHeight = 30;  // of Hershey's letters at scale 1, descent included
    const cv::Point corner(static_cast<int>(at.x() * kOversampling), static_cast<int>(at.y() * kOversampling));
    cv::putText(pixels_, words, corner, cv::FONT_HERSHEY_SIMPLEX, height_px * kOversampling / kFontHeight, colour,
                thickness(1.4), cv::LINE_AA);
  }
  void image(const FrameResult& frame) {
    const cv::Mat grey(frame.height_px, frame.width_px, CV_8U, const_cast<std::uint8_t*>(frame.grey.data()));
    cv::Mat scaled, colour;
    const double scale = image_scale(frame) * kOversampling;
    cv::resize(grey, scaled, {}, scale, scale, cv::INTER_CUBIC);
    cv::cvtColor(scaled, colour, cv::COLOR_GRAY2RGB);
    colour.copyTo(pixels_(cv::Rect(0, 0, colour.cols, colour.rows)));
  }
  static double image_scale(const FrameResult& frame) {
    return std::min(kImageWidth_px / frame.width_px, static_cast<double>(kFigureHeight_px) / frame.height_px);
  }

  ColourImage finished() const {
    cv::Mat reduced;
    cv::resize(pixels_, reduced, {kFigureWidth_px, kFigureHeight_px}, 0, 0, cv::INTER_AREA);
    return {reduced.cols, reduced.rows, {reduced.datastart, reduced.dataend}};
  }

 private:
  static constexpr int kShift = 4;  // OpenCV's fixed point: sixteenths of a pixel
  static cv::Point fixed(const Vec2d& point) {
    const Vec2d scaled = point * (kOversampling << kShift);
    return {static_cast<int>(std::lround(scaled.x())), static_cast<int>(std::lround(scaled.y()))};
  }
  static int thickness(double width_px) { return std::max(1, static_cast<int>(std::lround(width_px * kOversampling))); }

  cv::Mat pixels_;  // RGB
};

/// Parallel projection of the finger frame: the touched face and one of the open sides are seen, from a little above.
struct View {
  static constexpr double kAzimuth_rad = 0.75, kElevation_rad = 0.22, kPixelsPerMm = 3.7;
  static inline const Vec2d kOrigin_px{885, 475};
  Vec3d right{-std::cos(kAzimuth_rad), 0, -std::sin(kAzimuth_rad)};
  Vec3d towards_viewer = Vec3d(std::sin(kAzimuth_rad) * std::cos(kElevation_rad), std::sin(kElevation_rad),
                               -std::cos(kAzimuth_rad) * std::cos(kElevation_rad));
  Vec3d up = towards_viewer.cross(right);

  Vec2d pixel(const Vec3d& point_mm) const {
    return kOrigin_px + kPixelsPerMm * Vec2d(right.dot(point_mm), -up.dot(point_mm));
  }
};

Vec3d node(std::span<const float> nodes_mm, int index) {
  return Eigen::Map<const Vec3f>(&nodes_mm[3 * static_cast<std::size_t>(index)]).cast<double>();
}

/// Faces that belong to one tetrahedron only, counter-clockwise seen from outside.
std::vector<Triangle> surface_of(const ShapeModel& mesh) {
  std::map<Triangle, Triangle> once;  // by sorted nodes
  for (std::size_t tet = 0; tet < static_cast<std::size_t>(mesh.tets); ++tet) {
    const std::int32_t* n = &mesh.tet_nodes[4 * tet];
    for (const Triangle& face : {Triangle{n[0], n[2], n[1]}, Triangle{n[0], n[1], n[3]}, Triangle{n[0], n[3], n[2]},
                                 Triangle{n[1], n[2], n[3]}}) {
      Triangle key = face;
      std::sort(key.begin(), key.end());
      if (!once.emplace(key, face).second) once.erase(key);
    }
  }
  std::vector<Triangle> faces;
  for (const auto& [key, face] : once) faces.push_back(face);
  return faces;
}

Vec3d area_vector(std::span<const float> nodes_mm, const Triangle& face) {
  const Vec3d a = node(nodes_mm, face[0]);
  return (node(nodes_mm, face[1]) - a).cross(node(nodes_mm, face[2]) - a);
}

/// 0 ... 1 -> dark blue ... yellow, darkened by `shade` (1: not at all).
cv::Scalar colour_of(double share, double shade) {
  const cv::Mat level(1, 1, CV_8U, cv::Scalar(std::lround(255 * std::clamp(share, 0.0, 1.0))));
  cv::Mat colour;
  cv::applyColorMap(level, colour, cv::COLORMAP_VIRIDIS);
  const auto& bgr = colour.at<cv::Vec3b>(0);
  return cv::Scalar(bgr[2], bgr[1], bgr[0]) * shade;
}

/// The triangles that face the viewer, farthest first.
std::vector<Triangle> visible_faces(const View& view, const ShapeModel& mesh, std::span<const float> nodes_mm) {
  std::vector<std::pair<double, Triangle>> faces;
  for (const Triangle& face : surface_of(mesh)) {
    if (area_vector(nodes_mm, face).dot(view.towards_viewer) <= 0) continue;
    const Vec3d sum = node(nodes_mm, face[0]) + node(nodes_mm, face[1]) + node(nodes_mm, face[2]);
    faces.emplace_back(sum.dot(view.towards_viewer), face);
  }
  std::sort(faces.begin(), faces.end());
  std::vector<Triangle> ordered;
  for (const auto& [depth, face] : faces) ordered.push_back(face);
  return ordered;
}

void fill_face(Canvas& canvas, const View& view, std::span<const float> nodes_mm, const Triangle& face,
               const cv::Scalar& colour) {
  std::vector<Vec2d> corners;
  for (const int n : face) corners.push_back(view.pixel(node(nodes_mm, n)));
  canvas.fill(corners, colour);
}

/// The finger at rest as a grey shadow, in front of it the finger as it is now, lit from beside the viewer.
void draw_finger(Canvas& canvas, const View& view, const ShapeModel& mesh, std::span<const float> now_mm,
                 double largest_mm) {
  for (const Triangle& face : visible_faces(view, mesh, mesh.rest_mm)) {
    fill_face(canvas, view, mesh.rest_mm, face, kShadow);
  }
  const Vec3d light = (view.towards_viewer + 0.5 * view.up - 0.3 * view.right).normalized();
  for (const Triangle& face : visible_faces(view, mesh, now_mm)) {
    double moved_mm = 0;
    for (const int n : face) moved_mm += (node(now_mm, n) - node(mesh.rest_mm, n)).norm() / 3;
    const double shade = 0.55 + 0.45 * std::max(0.0, area_vector(now_mm, face).normalized().dot(light));
    fill_face(canvas, view, now_mm, face, colour_of(moved_mm / largest_mm, shade));
  }
}

/// From outside into the finger: against the mean normal of the touched face at rest.
Vec3d inward_normal(const ShapeModel& mesh) {
  std::vector<bool> is_front(static_cast<std::size_t>(mesh.nodes));
  for (const int n : mesh.front_nodes) is_front[static_cast<std::size_t>(n)] = true;
  Vec3d outward = Vec3d::Zero();
  for (const Triangle& face : surface_of(mesh)) {
    if (std::all_of(face.begin(), face.end(), [&](int n) { return is_front[static_cast<std::size_t>(n)]; })) {
      outward += area_vector(mesh.rest_mm, face);
    }
  }
  return -outward.normalized();
}

/// The point, the circle of radius radius_68_mm around it in the plane of the touched face, and the force as an arrow
/// that ends at it.
void draw_touch(Canvas& canvas, const View& view, const Touch& touch, const Vec3d& inward) {
  const Vec3d point = touch.contact_mm.cast<double>();
  const Vec3d across = inward.cross(Vec3d::UnitY()).normalized(), along = inward.cross(across);
  std::vector<Vec2d> circle;
  for (int i = 0; i < 60; ++i) {
    const double angle = 2 * EIGEN_PI * i / 60;
    circle.push_back(view.pixel(point + touch.radius_68_mm * (std::cos(angle) * across + std::sin(angle) * along)));
  }
  canvas.outline(circle, cv::Scalar::all(255), 4);
  canvas.outline(circle, kTouched, 2);
  const Vec2d tip = view.pixel(point - touch.radius_68_mm * inward);
  const Vec2d tail = view.pixel(point - (touch.radius_68_mm + kArrowMmPerNewton * touch.force_n) * inward);
  const Vec2d back = (tail - tip).normalized(), side(-back.y(), back.x());
  canvas.line(tail, tip + 10 * back, kTouched, 4);
  canvas.fill({tip, tip + 16 * back + 7 * side, tip + 16 * back - 7 * side}, kTouched);
}

void draw_markers(Canvas& canvas, const FrameResult& frame, const std::array<int, kPlates>& marker_id) {
  const double scale = Canvas::image_scale(frame);
  for (std::size_t plate = 0; plate < kPlates; ++plate) {
    if (!frame.corners.seen[plate]) continue;
    std::vector<Vec2d> corners;
    Eigen::AlignedBox2d box;
    for (const Vec2f& corner : frame.corners.corners_px[plate]) {
      // The centre of pixel (0, 0) lies half a pixel inside the image.
      corners.push_back(scale * (corner.cast<double>() + Vec2d(0.5, 0.5)));
      box.extend(corners.back());
    }
    canvas.outline(corners, kFound, 2.5);
    const Vec2d below_paper(box.center().x() - 38, box.max().y() + box.sizes().y() / 5 + 22);
    canvas.text(std::string(kPlateNames[plate]) + ", id " + std::to_string(marker_id[plate]), below_paper, kFound, 15);
  }
}

std::string printed(const char* format, auto... values) {
  char text[96];
  std::snprintf(text, sizeof text, format, static_cast<double>(values)...);
  return text;
}

void draw_legend(Canvas& canvas, double largest_mm) {
  constexpr double kLeft = 1085, kTop = 320, kHeight = 170, kWidth = 14;
  constexpr int kSteps = 85;
  for (int i = 0; i < kSteps; ++i) {
    const double low = kTop + kHeight * (1 - static_cast<double>(i) / kSteps), high = low - kHeight / kSteps;
    canvas.fill({{kLeft, low}, {kLeft + kWidth, low}, {kLeft + kWidth, high}, {kLeft, high}},
                colour_of((i + 0.5) / kSteps, 1));
  }
  canvas.text(printed("%.1f mm", largest_mm), {kLeft + kWidth + 8, kTop + 12}, kInk);
  canvas.text("0", {kLeft + kWidth + 8, kTop + kHeight}, kInk);
  canvas.text("displacement", {kLeft - 45, kTop - 14}, kInk);
}

void draw_captions(Canvas& canvas, const Touch& touch) {
  constexpr double kBottom = kFigureHeight_px - 30, kLeft = 1000, kTop = 40, kLine = 26;
  canvas.text("camera image, markers found", {12, kBottom}, kInk);
  canvas.text("reconstructed shape", {kImageWidth_px + 20, kTop}, kInk);
  canvas.text("grey: at rest", {kImageWidth_px + 20, kTop + kLine}, kInk);
  std::vector<std::string> lines = {"no touch"};
  if (touch.quality != Quality::kInvalid) {
    lines = {"touch",
             printed("x %6.1f mm", touch.point_mm.x()),
             printed("y %6.1f mm", touch.point_mm.y()),
             printed("z %6.1f mm", touch.point_mm.z()),
             printed("68 %% within %.1f mm", touch.radius_68_mm),
             printed("%.1f N", touch.force_n)};
  }
  for (std::size_t i = 0; i < lines.size(); ++i) {
    canvas.text(lines[i], {kLeft, kTop + kLine * static_cast<double>(i)}, kTouched);
  }
}

}  // namespace

ColourImage draw_figure(const ShapeModel& mesh, const std::array<int, kPlates>& marker_id, const FrameResult& frame) {
  Canvas canvas;
  canvas.image(frame);
  draw_markers(canvas, frame, marker_id);
  double largest_mm = 1;
  for (int n = 0; n < mesh.nodes; ++n) {
    largest_mm = std::max(largest_mm, (node(frame.node_mm, n) - node(mesh.rest_mm, n)).norm());
  }
  const View view;
  draw_finger(canvas, view, mesh, frame.node_mm, largest_mm);
  if (frame.touch.quality != Quality::kInvalid) draw_touch(canvas, view, frame.touch, inward_normal(mesh));
  draw_legend(canvas, largest_mm);
  draw_captions(canvas, frame.touch);
  return canvas.finished();
}

}  // namespace finsight::host
