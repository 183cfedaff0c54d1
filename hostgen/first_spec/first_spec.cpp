#include "hostgen/first_spec/first_spec.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <sstream>

#include "firmware/input_error.h"
#include "hostgen/finger/front_face.h"

namespace finsight::host {

namespace {

using Eigen::AlignedBox3d;
using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kLargestMarker_mm = 8;

AlignedBox3d bounds_of(const TriangleSurface& surface) {
  AlignedBox3d bounds;
  for (const Vector3d& at : surface.point_mm) bounds.extend(at);
  return bounds;
}

struct Unit {
  const char* name;
  double mm;
};

constexpr std::array<Unit, 4> kUnits = {{{"mm", 1}, {"m", 1000}, {"cm", 10}, {"inch", 25.4}}};

/// Those that give a usual finger, millimetres and metres before others, then the most usual.
std::vector<Unit> possible_units(double largest) {
  constexpr double kUsual_mm = 100;
  std::vector<Unit> units;
  for (const Unit& unit : kUnits) {
    if (largest * unit.mm >= 30 && largest * unit.mm <= 400) units.push_back(unit);
  }
  const auto away = [&](const Unit& unit) {
    const bool is_metric = unit.mm == 1 || unit.mm == 1000;
    return is_metric ? 0 : std::abs(std::log(largest * unit.mm / kUsual_mm));
  };
  std::ranges::stable_sort(units, {}, away);
  if (units.empty()) units.push_back(kUnits.front());
  return units;
}

/// What an end's cross-section takes up: that of the points near it.
double end_area(const TriangleSurface& surface, int axis, double end, double depth) {
  AlignedBox3d near;
  for (const Vector3d& at : surface.point_mm) {
    if (std::abs(at[axis] - end) <= depth) near.extend(at);
  }
  if (near.isEmpty()) return 0;
  const Vector3d size = near.sizes();
  return size[(axis + 1) % 3] * size[(axis + 2) % 3];
}

/// Area seen along `direction` of the largest connected part that faces it within 60 degrees.
double facing_area(const TriangleSurface& surface, const Vector3d& direction) {
  std::vector<double> area(surface.triangle.size());
  for (std::size_t t = 0; t < area.size(); ++t) {
    const Vector3d twice = surface.twice_area(t);
    if (twice.dot(direction) > 0.5 * twice.norm()) area[t] = 0.5 * twice.dot(direction);
  }
  double sum = 0;
  for (const std::size_t t : largest_patch(surface.triangle, area)) sum += area[t];
  return sum;
}

std::string axis_name(const Eigen::RowVector3d& row) {
  Eigen::Index axis = 0;
  row.cwiseAbs().maxCoeff(&axis);
  return std::string(row[axis] < 0 ? "\"-" : "\"") + "xyz"[axis] + "\"";
}

/// Rows: the finger's axes in those of the file.
Matrix3d guess_axes(const TriangleSurface& surface, std::vector<std::string>& notes) {
  const AlignedBox3d bounds = bounds_of(surface);
  const Vector3d size = bounds.sizes();
  Eigen::Index along = 0;
  size.maxCoeff(&along);
  const auto axis = static_cast<int>(along);
  const double low = end_area(surface, axis, bounds.min()[axis], 0.08 * size[axis]);
  const double high = end_area(surface, axis, bounds.max()[axis], 0.08 * size[axis]);
  const Vector3d y = (low >= high ? 1 : -1) * Vector3d::Unit(axis);
  if (std::abs(low - high) < 0.1 * std::max(low, high)) {
    notes.emplace_back(
        "both ends are as wide as each other: if the base is at the other end, turn two of surface.axes round");
  }
  Vector3d front = Vector3d::Zero();
  double best = 0, second = 0;
  for (int other = 1; other <= 2; ++other) {
    for (const int sign : {-1, 1}) {
      const Vector3d direction = sign * Vector3d::Unit((axis + other) % 3);
      const double area = facing_area(surface, direction);
      if (area > best) {
        second = best;
        best = area;
        front = direction;
      } else {
        second = std::max(second, area);
      }
    }
  }
  if (second > 0.85 * best) {
    notes.emplace_back("two sides are nearly as large as each other: check that the touched one is in front (-z)");
  }
  Matrix3d R;
  R.row(1) = y;
  R.row(2) = -front;
  R.row(0) = y.cross(Vector3d(-front));
  return R;
}

/// The touched face, and how far it reaches.
class Face {
 public:
  Face(const TriangleSurface& surface, const AlignedBox3d& box) : surface_(surface) {
    for (const std::size_t t : front_patch(surface.point_mm, surface.triangle, box)) {
      triangles_.push_back(t);
      for (const Vector3d& corner : surface.corners(t)) bounds_.extend(corner);
    }
  }
  const AlignedBox3d& bounds_mm() const { return bounds_; }

  /// To both sides of x = 0.
  double half_width_mm(double y_mm) const {
    constexpr double kStep_mm = 0.25;
    double half = 0;
    while (half < 500 && holds(half + kStep_mm, y_mm) && holds(-half - kStep_mm, y_mm)) half += kStep_mm;
    return half;
  }

 private:
  bool holds(double x, double y) const {
    return std::ranges::any_of(triangles_, [&](std::size_t t) {
      const auto corner = surface_.corners(t);
      const Vector3d at = point_at(corner, nearest_in_triangle(corner, x, y));
      return std::hypot(at.x() - x, at.y() - y) < 1e-3;
    });
  }
  const TriangleSurface& surface_;
  std::vector<std::size_t> triangles_;
  AlignedBox3d bounds_;
};

struct TouchGuess {
  std::array<double, 2> y_mm{}, half_width_mm{};
};

TouchGuess guess_touch(const Face& face) {
  constexpr double kEdge_mm = 1;
  const double low = face.bounds_mm().min().y(), high = face.bounds_mm().max().y();
  TouchGuess touch;
  touch.y_mm = {std::ceil(low + 0.12 * (high - low)), std::floor(high - 0.1 * (high - low))};
  touch.half_width_mm = {face.half_width_mm(touch.y_mm[0]) - kEdge_mm, face.half_width_mm(touch.y_mm[1]) - kEdge_mm};
  for (int k = 0; k <= 12; ++k) {  // narrower between them?
    const double share = k / 12.0, room = face.half_width_mm(std::lerp(touch.y_mm[0], touch.y_mm[1], share)) - kEdge_mm;
    const double wanted = std::lerp(touch.half_width_mm[0], touch.half_width_mm[1], share);
    if (wanted <= room || !(wanted > 0)) continue;
    for (double& half : touch.half_width_mm) half *= room / wanted;
  }
  for (double& half : touch.half_width_mm) half = std::floor(2 * std::max(0.0, half)) / 2;
  return touch;
}

std::string number(double value) {
  std::ostringstream text;
  text << std::round(100 * value) / 100;
  return text.str();
}
/// A TOML basic string.
std::string quoted(const std::string& name) {
  std::string text = "\"";
  for (const char c : name) {
    const auto code = static_cast<unsigned char>(c);
    if (code < 0x20 || code == 0x7f) {
      char escape[8];
      std::snprintf(escape, sizeof escape, "\\u%04X", code);
      text += escape;
      continue;
    }
    if (c == '"' || c == '\\') text += '\\';
    text += c;
  }
  return text + "\"";
}
std::string triple(const Vector3d& v) {
  std::ostringstream text;
  text << "[" << number(v.x()) << ", " << number(v.y()) << ", " << number(v.z()) << "]";
  return text.str();
}
std::string box_text(const AlignedBox3d& box) {
  return "{ min_mm = " + triple(box.min()) + ", max_mm = " + triple(box.max()) + " }";
}

constexpr const char* kLenses = R"(
# A lens of 66 x 52 degrees; `hostgen calibrate` measures that of a device.
[camera.size_1280x720]
fx = 736.05
fy = 735.90
cx = 615.63
cy = 365.71
k1 = -0.3956
k2 = 0.2259
p1 = 0
p2 = 0
k3 = -0.0912

[camera.size_640x480]
fx = 490.70
fy = 490.60
cx = 303.5867
cy = 243.6400
k1 = -0.3956
k2 = 0.2259
p1 = 0
p2 = 0
k3 = -0.0912
)";

std::string plates_text(const FirstSpec& first) {
  std::string text;
  for (std::size_t p = 0; p < kPlates; ++p) {
    const bool found = p < first.plates.size();
    const std::string comment = found ? "" : "# ";
    text += "\n";
    if (!found) text += "# No level underside with room for a marker was found for this one.\n";
    text += comment + "[plates." + kPlateNames[p] + "]\n";
    text += comment +
            "box = " + (found ? box_text(first.plates[p].box_mm) : "{ min_mm = [0, 0, 0], max_mm = [0, 0, 0] }") + "\n";
    text += comment + "marker_mm = " + (found ? triple(first.plates[p].marker_mm) : "[0, 0, 0]") + "\n";
    text += comment + "marker_id = " + std::to_string(p) + "\n";
    text += comment + "range = { inward_mm = 3, sideways_mm = 1, tilt_deg = 3, turn_deg = 3 }\n";
    text += comment + "noise = { lateral_mm = 0.013, depth_mm = 0.08, tilt_deg = 0.3, roll_deg = 0.06 }\n";
  }
  return text;
}

std::string spec_text(const FirstSpec& first, const std::filesystem::path& file, const TouchGuess& touch) {
  const SurfaceSource& source = first.finger.source;
  std::string text =
      "# Written by hostgen new from " + quoted(file.filename()) + ". Guessed from the shape alone: check it.\n";
  for (const std::string& note : first.notes) text += "# NOTE: " + note + "\n";
  text += "name = " + quoted(file.stem()) + "\n\n[surface]\nfile = " + quoted(source.file) + "\nunits = \"" +
          source.units + "\"\naxes = [" + axis_name(source.R_finger_file.row(0)) + ", " +
          axis_name(source.R_finger_file.row(1)) + ", " + axis_name(source.R_finger_file.row(2)) +
          "]   # the file's axes along finger x (across), y (up from the base), z (into the finger)\norigin_mm = " +
          triple(source.origin_mm) + "\n";
  if (source.simplify_mm > 0) text += "simplify_mm = " + number(source.simplify_mm) + "   # the surface has slivers\n";
  text += "base = " + box_text(source.base_mm) + "   # what is fixed\n";
  text += "front = " + box_text(source.front_mm) + "   # holds the touched face\n";
  text +=
      "\n[material]\nyoungs_modulus_mpa = 10          # polyurethane of 90 Shore A\npoisson_ratio = 0.47\n"
      "plate_stiffness_ratio = 100\n\n[markers]\ndictionary = \"DICT_4X4_50\"\nsize_mm = " +
      number(first.marker_size_mm) + "\n\n# range and noise are guesses: `hostgen probe` proposes them.\n";
  text += plates_text(first);
  text += "\n[camera]\nposition_mm = " + triple(first.camera_mm) + "\nlook = [0, 1, 0]\n" + kLenses;
  text += "\n# `hostgen probe` proposes force_n, threshold_mm and rated_deformation_mm.\n[touch]\ny_mm = [" +
          number(touch.y_mm[0]) + ", " + number(touch.y_mm[1]) + "]\nhalf_width_mm = [" +
          number(touch.half_width_mm[0]) + ", " + number(touch.half_width_mm[1]) +
          "]\nforce_n = [0.5, 5]\nthreshold_mm = 1\nrated_deformation_mm = 4\n";
  return text;
}

void note_other_units(const TriangleSurface& surface, const std::string& units, std::vector<std::string>& notes) {
  const auto own = std::ranges::find(kUnits, units, &Unit::name);
  if (own->mm == 1) return;
  const double long_mm = bounds_of(surface).sizes().maxCoeff();
  for (const Unit& other : possible_units(long_mm / own->mm)) {
    if (units == other.name) continue;
    notes.push_back("the finger is " + number(long_mm) + " mm long if the file's numbers are " + units + ", and " +
                    number(long_mm / own->mm * other.mm) + " mm if they are " + other.name + ": check surface.units");
  }
}

/// A triangle is a sliver if its height is a small part of its longest side.
bool has_slivers(const TriangleSurface& surface) {
  constexpr double kThin = 0.01;
  for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
    const auto corner = surface.corners(t);
    const double longest = std::max({(corner[1] - corner[0]).squaredNorm(), (corner[2] - corner[1]).squaredNorm(),
                                     (corner[0] - corner[2]).squaredNorm()});
    if (surface.twice_area(t).norm() < kThin * longest) return true;
  }
  return false;
}

/// In the finger frame: y = 0 at the base, x = 0 and z = 0 in the middle.
void place(FirstSpec& first, TriangleSurface surface) {
  SurfaceSource& source = first.finger.source;
  source.R_finger_file = guess_axes(surface, first.notes);
  AlignedBox3d bounds;
  for (const Vector3d& at : surface.point_mm) bounds.extend(source.R_finger_file * at);
  source.origin_mm =
      source.R_finger_file.transpose() * Vector3d(bounds.center().x(), bounds.min().y(), bounds.center().z());
  for (double& value : source.origin_mm) value = std::round(100 * value) / 100;
  for (Vector3d& at : surface.point_mm) at = source.R_finger_file * (at - source.origin_mm);
  first.finger.surface = std::move(surface);
}

void guess_camera_and_markers(FirstSpec& first) {
  first.plates = best_plates(first.finger.surface);
  double room_mm = kLargestMarker_mm / kMarkerShare;
  Vector3d middle = bounds_of(first.finger.surface).center();
  if (!first.plates.empty()) middle.setZero();
  for (std::size_t p = 0; p < first.plates.size(); ++p) {
    room_mm = std::min(room_mm, first.plates[p].room_mm);
    middle += first.plates[p].marker_mm / static_cast<double>(first.plates.size());
    first.finger.source.plates[p].box_mm = first.plates[p].box_mm;
    if (first.plates[p].visible) continue;
    first.notes.emplace_back(std::string("the ") + kPlateNames[p] + " plate is hidden from the camera below the base");
  }
  first.marker_size_mm = std::floor(10 * kMarkerShare * room_mm) / 10;
  first.camera_mm = Vector3d(std::round(middle.x()), -kCameraBelow_mm, std::round(middle.z()));
  if (first.plates.size() < kPlates) {
    first.notes.emplace_back(
        std::to_string(first.plates.size()) +
        " plates found, three are needed: level undersides, at least 6 mm wide, at three heights, as 2 mm "
        "plates that hang on the finger by their upper faces");
  }
}

}  // namespace

SurfaceFinger read_as_drawn(const std::filesystem::path& surface_file) {
  SurfaceFinger finger;
  finger.surface = read_triangles(surface_file, 1);
  const Unit unit = possible_units(bounds_of(finger.surface).sizes().maxCoeff()).front();
  if (unit.mm != 1) finger.surface = read_triangles(surface_file, unit.mm);
  finger.source.units = unit.name;
  finger.source.file = surface_file;
  return finger;
}

FirstSpec propose_spec(const std::filesystem::path& surface_file, const std::filesystem::path& spec_file) {
  constexpr double kMargin_mm = 1, kSimplify_mm = 0.05;
  FirstSpec first;
  first.finger = read_as_drawn(surface_file);
  SurfaceSource& source = first.finger.source;
  TriangleSurface surface = std::move(first.finger.surface);
  check_bounds_a_solid(surface, surface_file.string());
  note_other_units(surface, source.units, first.notes);
  source.file = std::filesystem::relative(surface_file, std::filesystem::absolute(spec_file).parent_path());
  if (has_slivers(surface)) {
    source.simplify_mm = kSimplify_mm;
    simplify(surface, kSimplify_mm);
  }
  place(first, std::move(surface));

  const AlignedBox3d bounds = bounds_of(first.finger.surface);
  const Vector3d margin = Vector3d::Constant(kMargin_mm);
  source.base_mm = AlignedBox3d(bounds.min() - margin, bounds.max() + margin);
  source.base_mm.max().y() = bounds.min().y() + 0.5;
  source.front_mm = AlignedBox3d(bounds.min() - margin, bounds.max() + margin);
  const Face face(first.finger.surface, source.front_mm);
  if (face.bounds_mm().isEmpty()) {
    throw InputError(surface_file.string(), "surface", "no face that looks to one side",
                     "a finger with a touched face");
  }
  source.front_mm.max().z() = face.bounds_mm().max().z() + kMargin_mm;
  const TouchGuess touch = guess_touch(face);
  if (std::min(touch.half_width_mm[0], touch.half_width_mm[1]) < 1) {
    first.notes.emplace_back(
        "the touched face does not lie evenly about x = 0, or is very narrow: set touch.half_width_mm "
        "and surface.origin_mm by hand");
  }
  guess_camera_and_markers(first);
  first.toml = spec_text(first, surface_file, touch);
  return first;
}

}  // namespace finsight::host
