// Rays from the camera to every plate's marker, at rest and at the corners of the working range. The finger bends as
// one piece: each plate moves rigidly with its crossbeam, the base stands still, the cap moves with the top plate, and
// what lies between is blended over the height. The finger's surface, so moved, is what a ray may hit.
#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <optional>
#include <sstream>
#include <vector>

#include "firmware/geometry/so3.h"
#include "firmware/input_error.h"
#include "hostgen/finger/grid.h"
#include "hostgen/finger/mesh.h"
#include "hostgen/finger/plate_geometry.h"
#include "hostgen/finger/surface_finger.h"

namespace finsight::host {

namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;

constexpr int kSamples = 9;                    // per side of the marker: 1.3 mm apart at 8 mm, obstacles are thicker
constexpr double kMarginShare = 1.0 / 60;      // of the image's height: 12 and 8 pixels
constexpr double kSmallestFacingCosine = 0.3;  // a marker seen more from the side than this is too narrow to be read

/// A corner of the working range: directions, and how much of the range.
struct Pose {
  double share = 0;
  double sideways = 0, tilt_x = 0, turn = 0, tilt_z = 0;
};

std::vector<Pose> poses_to_check() {
  std::vector<Pose> poses = {Pose{}};
  for (const double share : {0.5, 1.0}) {
    for (int corner = 0; corner < 16; ++corner) {
      const auto sign = [&](int bit) { return corner >> bit & 1 ? 1.0 : -1.0; };
      poses.push_back({share, sign(0), sign(1), sign(2), sign(3)});
    }
  }
  return poses;
}

/// Where a plate's rest points go.
Isometry3d plate_motion(const PlateSpec& plate, const Pose& pose) {
  const WorkingRange& range = plate.range;
  Vector3d centre = plate.T_finger_marker.translation();
  centre.x() = 0;
  const Vector3d rotation =
      pose.share * Vector3d(pose.tilt_x * range.tilt_rad, pose.turn * range.turn_rad, pose.tilt_z * range.tilt_rad);
  const Vector3d shift = pose.share * Vector3d(pose.sideways * range.sideways_mm, 0, range.inward_mm);
  Isometry3d motion = Isometry3d::Identity();
  motion.linear() = so3_exp(rotation);
  motion.translation() = centre - motion.linear() * centre + shift;
  return motion;
}

/// The bent finger: rigid motions at given heights, blended between them.
struct Bending {
  struct Knot {
    double y_mm;
    Isometry3d motion;
  };
  std::vector<Knot> knots;  // ascending

  Bending(const FingerSpec& spec, const Pose& pose) {
    knots.push_back({0, Isometry3d::Identity()});
    for (int plate = kPlates - 1; plate >= 0; --plate) {
      const Isometry3d motion = plate_motion(spec.plates[plate], pose);
      for (const double y_mm : carried_y_mm(spec, plate)) knots.push_back({y_mm, motion});
    }
  }

  Vector3d moved(const Vector3d& rest) const {
    std::size_t upper = 0;
    while (upper < knots.size() && knots[upper].y_mm < rest.y()) ++upper;
    if (upper == 0) return knots.front().motion * rest;
    if (upper == knots.size()) return knots.back().motion * rest;
    const Knot &a = knots[upper - 1], &b = knots[upper];
    const double share = (rest.y() - a.y_mm) / (b.y_mm - a.y_mm);
    return (1 - share) * (a.motion * rest) + share * (b.motion * rest);
  }
};

/// A triangle of the finger at rest.
struct SkinTriangle {
  std::array<Vector3d, 3> corner;
  int plate = -1;    // whose it is; -1: the body's
  std::string part;  // in words
};

/// The surface of all filled cells, two triangles per face that borders on air.
std::vector<SkinTriangle> skin_of(const FingerGrid& grid) {
  std::vector<SkinTriangle> skin;
  const int nx = grid.cells(0), ny = grid.cells(1);
  for (std::size_t index = 0; index < grid.labels.size(); ++index) {
    const int i = static_cast<int>(index);
    const std::array<int, 3> cell = {i % nx, i / nx % ny, i / (nx * ny)};
    if (grid.label(cell) == kAir) continue;
    const int plate = std::max(grid.label(cell) - kFirstPlate, -1);
    for (int axis = 0; axis < 3; ++axis) {
      for (const int side : {0, 1}) {
        std::array<int, 3> neighbour = cell;
        neighbour[axis] += side == 0 ? -1 : 1;
        if (grid.label(neighbour) != kAir) continue;
        const auto corner = [&](int u, int v) {
          std::array<int, 3> spot = cell;
          spot[axis] += side;
          spot[(axis + 1) % 3] += u;
          spot[(axis + 2) % 3] += v;
          return grid.point(spot);
        };
        skin.push_back({{corner(0, 0), corner(1, 0), corner(0, 1)}, plate, grid.part_name(cell)});
        skin.push_back({{corner(1, 1), corner(0, 1), corner(1, 0)}, plate, grid.part_name(cell)});
      }
    }
  }
  return skin;
}

std::vector<SkinTriangle> skin_of(const SurfaceFinger& finger) {
  std::vector<SkinTriangle> skin;
  for (std::size_t t = 0; t < finger.surface.triangle.size(); ++t) {
    skin.push_back({finger.surface.corners(t), -1, "the finger around " + place_text(finger.surface.middle(t))});
  }
  for (int plate = 0; plate < kPlates; ++plate) {
    for (const std::size_t t : finger.plate_skin[plate]) {
      skin[t].plate = plate;
      skin[t].part = std::string("the ") + kPlateNames[plate] + " plate";
    }
  }
  return skin;
}

/// Where it is in the bent finger.
struct Triangle {
  Vector3d corner, edge1, edge2;
  const SkinTriangle* rest = nullptr;
};

std::vector<Triangle> moved(const std::vector<SkinTriangle>& skin, const Bending& bending) {
  std::vector<Triangle> triangles;
  for (const SkinTriangle& rest : skin) {
    const Vector3d a = bending.moved(rest.corner[0]), b = bending.moved(rest.corner[1]),
                   c = bending.moved(rest.corner[2]);
    triangles.push_back({a, b - a, c - a, &rest});
  }
  return triangles;
}

/// Moeller and Trumbore: the share of the way from `from` along `ray` at which it meets the triangle.
std::optional<double> hit(const Triangle& triangle, const Vector3d& from, const Vector3d& ray) {
  const Vector3d p = ray.cross(triangle.edge2);
  const double determinant = triangle.edge1.dot(p);
  if (determinant == 0) return std::nullopt;
  const Vector3d s = from - triangle.corner;
  const double u = s.dot(p) / determinant;
  if (u < 0 || u > 1) return std::nullopt;
  const Vector3d q = s.cross(triangle.edge1);
  const double v = ray.dot(q) / determinant;
  if (v < 0 || u + v > 1) return std::nullopt;
  return triangle.edge2.dot(q) / determinant;
}

/// One of the camera's lenses.
struct Sight {
  Lens lens;
  double turning_radius_sq;

  /// Whether a point in the camera frame is seen, away from the image's edge.
  bool sees(const Vector3d& point) const {
    if (point.z() <= 0) return false;
    const Eigen::Vector2d ray = point.head<2>() / point.z();
    if (ray.squaredNorm() >= turning_radius_sq) return false;
    const Eigen::Vector2d pixel = pixel_from_ray(lens, ray);
    const double margin = kMarginShare * lens.height_px;
    return pixel.minCoeff() >= margin && pixel.x() <= lens.width_px - 1 - margin &&
           pixel.y() <= lens.height_px - 1 - margin;
  }
};

/// Points of the marker with its white border, in the finger frame.
std::vector<Vector3d> marker_points(const FingerSpec& spec, int plate, const Isometry3d& motion) {
  const double half_mm = spec.marker_size_mm * (0.5 + 1.0 / 6);
  std::vector<Vector3d> points;
  for (int v = 0; v < kSamples; ++v) {
    for (int u = 0; u < kSamples; ++u) {
      const Vector3d on_marker(half_mm * (2.0 * u / (kSamples - 1) - 1), half_mm * (2.0 * v / (kSamples - 1) - 1), 0);
      points.push_back(motion * (spec.plates[plate].T_finger_marker * on_marker));
    }
  }
  return points;
}

/// What keeps the camera from seeing the marker, in words; nothing if it sees it whole.
std::optional<std::string> obstacle(const FingerSpec& spec, int plate, const Isometry3d& motion,
                                    const std::vector<Sight>& sights, const std::vector<Triangle>& surface) {
  const Vector3d camera = spec.T_finger_camera.translation();
  const Isometry3d T_camera_finger = spec.T_finger_camera.inverse();
  const Vector3d normal = motion.linear() * spec.plates[plate].T_finger_marker.linear().col(2);
  for (const Vector3d& point : marker_points(spec, plate, motion)) {
    const Vector3d ray = point - camera;
    if (-ray.dot(normal) < kSmallestFacingCosine * ray.norm()) return "turned away from the camera";
    for (const Sight& sight : sights) {
      if (sight.sees(T_camera_finger * point)) continue;
      return "outside the image of " + std::to_string(sight.lens.width_px) + "x" + std::to_string(sight.lens.height_px);
    }
    double nearest = 1;
    const Triangle* first = nullptr;
    for (const Triangle& triangle : surface) {
      if (triangle.rest->plate == plate) continue;
      const std::optional<double> share = hit(triangle, camera, ray);
      if (!share || *share <= 0 || *share >= nearest) continue;
      nearest = *share;
      first = &triangle;
    }
    if (first) return "hidden by " + first->rest->part;
  }
  return std::nullopt;
}

std::string described(const WorkingRange& range, const Pose& pose) {
  if (pose.share == 0) return "at rest";
  const double deg = pose.share * 180 / std::numbers::pi;
  std::ostringstream text;
  text << "when moved inward by " << pose.share * range.inward_mm << " mm and sideways by "
       << pose.share * pose.sideways * range.sideways_mm << " mm, rotated about x, y, z by "
       << deg * pose.tilt_x * range.tilt_rad << ", " << deg * pose.turn * range.turn_rad << ", "
       << deg * pose.tilt_z * range.tilt_rad << " deg";
  return text.str();
}

}  // namespace

void check_visibility(const FingerSpec& spec) {
  std::vector<Sight> sights;
  for (const Lens& lens : spec.cameras) sights.push_back({lens, turning_radius_sq(lens)});
  const std::vector<SkinTriangle> skin = spec.surface ? skin_of(*spec.surface) : skin_of(make_grid(spec));
  for (const Pose& pose : poses_to_check()) {
    const std::vector<Triangle> surface = moved(skin, Bending(spec, pose));
    for (int plate = 0; plate < kPlates; ++plate) {
      const PlateSpec& p = spec.plates[plate];
      if (const auto reason = obstacle(spec, plate, plate_motion(p, pose), sights, surface)) {
        throw InputError(spec.file.string(), std::string("plates.") + kPlateNames[plate],
                         "a marker " + *reason + " " + described(p.range, pose),
                         "one that the camera sees whole, with its white border");
      }
    }
  }
}

}  // namespace finsight::host
