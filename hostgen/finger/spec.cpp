#include "hostgen/finger/spec.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>
#include <sstream>

#include "firmware/input_error.h"
#include "firmware/settings/toml_table.h"
#include "hostgen/finger/front_face.h"
#include "hostgen/finger/grid.h"
#include "hostgen/finger/mesh.h"
#include "hostgen/finger/plate_geometry.h"
#include "hostgen/finger/surface_finger.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180;
constexpr double kLargestMm = 1000;  // larger is not a finger
constexpr double kPolyurethane_kg_m3 = 1150;

std::array<double, 2> pair(TomlTable& table, const std::string& key, double lowest, double highest) {
  const std::vector<double> values = table.numbers(key, 2, lowest, highest);
  return {values[0], values[1]};
}

std::array<double, 2> ascending_pair(TomlTable& table, const std::string& key, double lowest, double highest) {
  const std::array<double, 2> values = pair(table, key, lowest, highest);
  if (values[0] < values[1]) return values;
  throw InputError(table.where(key), key, std::to_string(values[0]) + ", " + std::to_string(values[1]),
                   "two ascending numbers");
}

Eigen::Vector3d vector3(TomlTable& table, const std::string& key, double largest) {
  const std::vector<double> values = table.numbers(key, 3, -largest, largest);
  return {values[0], values[1], values[2]};
}

void read_shape(TomlTable table, FingerSpec& spec) {
  const auto thickness = [&](const char* key) { return table.number(key, 0.5, kLargestMm); };
  spec.height_mm = table.number("height_mm", 1, kLargestMm);
  const auto taper = [&](const char* key, double lowest) {
    const auto [base, tip] = pair(table, key, lowest, kLargestMm);
    return Taper{base, (tip - base) / spec.height_mm};
  };
  spec.front_z = taper("front_z_mm", -kLargestMm);
  spec.back_z = taper("back_z_mm", -kLargestMm);
  spec.half_width = taper("half_width_mm", 0.5);
  spec.front_wall_mm = thickness("front_wall_mm");
  spec.back_wall_mm = thickness("back_wall_mm");
  spec.side_wall_mm = thickness("side_wall_mm");
  spec.base_ring_mm = thickness("base_ring_mm");
  spec.top_mm = thickness("top_mm");
  spec.beam_mm = thickness("beam_mm");
  spec.plate_mm = thickness("plate_mm");
  table.finish();
}

/// By its corners, or as the box around the faces that the surface's file has under a label: found when that is read.
Eigen::AlignedBox3d read_box(TomlTable table, const std::string& field, SurfaceSource& source) {
  if (table.has("label")) {
    source.label[field] = table.text("label");
    table.finish();
    return {};
  }
  const Eigen::Vector3d lowest = vector3(table, "min_mm", kLargestMm), highest = vector3(table, "max_mm", kLargestMm);
  if (!(lowest.array() < highest.array()).all()) {
    throw InputError(table.where("max_mm"), "max_mm", place_text(highest), "more than min_mm in all three");
  }
  table.finish();
  return {lowest, highest};
}

/// Which of the file's axes lie along the finger's x, y and z: ["x", "z", "-y"] for a finger that stands along the
/// file's z.
Eigen::Matrix3d read_axes(TomlTable& table) {
  const std::vector<std::string> names = table.texts("axes");
  Eigen::Matrix3d R = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < names.size() && i < 3; ++i) {
    const bool negative = names[i].starts_with('-');
    const std::size_t axis = std::string("xyz").find(names[i].substr(negative));
    if (names[i].size() == 1U + negative && axis < 3)
      R(static_cast<int>(i), static_cast<int>(axis)) = negative ? -1 : 1;
  }
  if (names.size() != 3 || R.determinant() != 1) {
    throw InputError(table.where("axes"), "surface.axes", "axes that do not make a right-handed frame",
                     "three of \"x\", \"-x\" ... \"-z\", such as [\"x\", \"z\", \"-y\"]");
  }
  return R;
}

void read_surface(TomlTable table, SurfaceSource& source) {
  source.file = table.path("file");
  if (table.has("axes")) source.R_finger_file = read_axes(table);
  if (table.has("origin_mm")) source.origin_mm = vector3(table, "origin_mm", 100 * kLargestMm);
  source.simplify_mm = table.number("simplify_mm", 0, 5, 0);
  source.units = table.choice("units", {"mm", "cm", "m", "inch"});
  source.base_mm = read_box(table.table("base"), "surface.base", source);
  source.front_mm = read_box(table.table("front"), "surface.front", source);
  table.finish();
}

/// In a surface, the plate's box says where it is; in a parametric finger, fractions of its inner width and depth.
void read_place(TomlTable& entry, FingerSpec& spec, int index, SurfaceSource* source) {
  PlateSpec& plate = spec.plates[index];
  if (!source) {
    plate.beam_y_mm = entry.number("beam_y_mm", 0, kLargestMm);
    plate.across = ascending_pair(entry, "across", -1, 1);
    plate.deep = ascending_pair(entry, "deep", 0, 1);
    return;
  }
  PlateBox& box = source->plates[index];
  box.box_mm = read_box(entry.table("box"), box_field(index), *source);
  const std::string joined = entry.choice("joined", {"-x", "+x", "-y", "+y", "-z", "+z"}, "+y");
  box.axis = joined[1] - 'x';
  box.side = joined[0] == '+' ? 1 : -1;
  plate.T_finger_marker.translation() = vector3(entry, "marker_mm", kLargestMm);
}

void read_material(TomlTable table, FingerSpec& spec) {
  spec.youngs_modulus_mpa = table.number("youngs_modulus_mpa", 1e-3, 1e6);
  spec.poisson_ratio = table.number("poisson_ratio", 0, 0.499);  // 0.5 is incompressible
  spec.density_kg_m3 = table.number("density_kg_m3", 10, 1e5, kPolyurethane_kg_m3);
  spec.plate_stiffness_ratio = table.number("plate_stiffness_ratio", 1, 1e4);
  table.finish();
}

WorkingRange read_range(TomlTable table) {
  WorkingRange range;
  range.inward_mm = table.number("inward_mm", 0, kLargestMm);
  range.sideways_mm = table.number("sideways_mm", 0, kLargestMm);
  range.tilt_rad = table.number("tilt_deg", 0, 80) * kRadPerDeg;
  range.turn_rad = table.number("turn_deg", 0, 80) * kRadPerDeg;
  table.finish();
  return range;
}

PoseNoise read_noise(TomlTable table) {
  PoseNoise noise;
  noise.lateral_mm = table.number("lateral_mm", 0, 100);
  noise.depth_mm = table.number("depth_mm", 0, 100);
  noise.tilt_rad = table.number("tilt_deg", 0, 90) * kRadPerDeg;
  noise.roll_rad = table.number("roll_deg", 0, 90) * kRadPerDeg;
  table.finish();
  return noise;
}

/// `source`: of the surface; none for a parametric finger.
void read_plates(TomlTable table, FingerSpec& spec, SurfaceSource* source) {
  std::set<int> ids;
  for (int index = 0; index < kPlates; ++index) {
    TomlTable entry = table.table(kPlateNames[index]);
    PlateSpec& plate = spec.plates[index];
    read_place(entry, spec, index, source);
    plate.marker_id = static_cast<int>(entry.integer("marker_id", 0, 49));  // DICT_4X4_50 has 50 markers
    if (!ids.insert(plate.marker_id).second) {
      throw InputError(entry.where("marker_id"), "marker_id", std::to_string(plate.marker_id) + " twice",
                       "a different marker on every plate");
    }
    plate.range = read_range(entry.table("range"));
    spec.noise[index] = read_noise(entry.table("noise"));
    entry.finish();
  }
  table.finish();
}

void read_markers(TomlTable table, FingerSpec& spec) {
  table.choice("dictionary", {"DICT_4X4_50"});
  spec.marker_size_mm = table.number("size_mm", 0.1, 100);
  table.finish();
}

Lens read_lens(TomlTable table, int width_px, int height_px) {
  Lens c;
  c.width_px = width_px;
  c.height_px = height_px;
  c.fx = table.number("fx", 10, 1e5);
  c.fy = table.number("fy", 10, 1e5);
  c.cx = table.number("cx", 0, width_px);
  c.cy = table.number("cy", 0, height_px);
  c.k1 = table.number("k1", -10, 10);
  c.k2 = table.number("k2", -10, 10);
  c.p1 = table.number("p1", -1, 1);
  c.p2 = table.number("p2", -1, 1);
  c.k3 = table.number("k3", -10, 10);
  table.finish();
  return c;
}

void read_camera(TomlTable table, FingerSpec& spec) {
  const Eigen::Vector3d look = vector3(table, "look", 1e6);
  const Eigen::Vector3d across = Eigen::Vector3d::UnitX() * look.squaredNorm() - look * look.x();
  if (look.norm() < 1e-6 || across.norm() < 1e-3 * look.squaredNorm()) {
    throw InputError(table.where("look"), "camera.look", "no direction, or finger x",
                     "a direction that is not along finger x");
  }
  Eigen::Matrix3d axes;  // camera x stays as near to finger x as the line of sight allows
  axes.col(0) = across.normalized();
  axes.col(2) = look.normalized();
  axes.col(1) = axes.col(2).cross(axes.col(0));
  spec.T_finger_camera.linear() = axes;
  spec.T_finger_camera.translation() = vector3(table, "position_mm", kLargestMm);
  spec.cameras[0] = read_lens(table.table("size_1280x720"), 1280, 720);
  spec.cameras[1] = read_lens(table.table("size_640x480"), 640, 480);
  table.finish();
}

/// All touched points lie on the face, not beside it.
void check_touch_on_face(const FingerSpec& spec, const std::string& where) {
  constexpr int kSteps = 12;
  constexpr double kBesideMm = 0.01;
  for (int i = 0; i <= kSteps; ++i) {
    const double y_mm = spec.touch_y_mm[0] + (spec.touch_y_mm[1] - spec.touch_y_mm[0]) * i / kSteps;
    for (int j = 0; j <= kSteps; ++j) {
      const Eigen::Vector2d at(spec.half_width.at(y_mm) * (2.0 * j / kSteps - 1), y_mm);
      if ((front_point_mm(spec, at.x(), at.y()).head<2>() - at).norm() < kBesideMm) continue;
      std::ostringstream found;
      found << "a touch at x, y = " << at.x() << ", " << at.y() << " mm, beside the touched face";
      throw InputError(where, "touch", found.str(), "y_mm and half_width_mm within the face that surface.front holds");
    }
  }
}

void read_touch(TomlTable table, FingerSpec& spec) {
  spec.touch_y_mm = ascending_pair(table, "y_mm", spec.surface ? -kLargestMm : 0, spec.height_mm);
  const auto [lowest_mm, highest_mm] = spec.touch_y_mm;
  if (spec.surface) {
    const auto [low, high] = pair(table, "half_width_mm", 0.5, kLargestMm);
    const double slope = (high - low) / (highest_mm - lowest_mm);
    spec.half_width = {low - slope * lowest_mm, slope};
    check_touch_on_face(spec, table.where("half_width_mm"));
  } else {
    const double narrowest_mm = std::min(spec.half_width.at(lowest_mm), spec.half_width.at(highest_mm));
    spec.touch_edge_mm = table.number("edge_mm", 0, narrowest_mm);
  }
  spec.force_n = ascending_pair(table, "force_n", 0, 1000);
  spec.threshold_mm = table.number("threshold_mm", 0, 100);
  spec.rated_deformation_mm = table.number("rated_deformation_mm", 0.01, 1000);
  spec.trained_scene = table.text("scene", "probe");
  if (spec.scene(spec.trained_scene).elsewhere) {
    throw InputError(table.where("scene"), "touch.scene", "'" + spec.trained_scene + "'",
                     "a scene of the touched face");
  }
  table.finish();
}

Tolerance read_tolerance(TomlTable table) {
  const Tolerance usual;
  Tolerance tolerance;
  tolerance.force = table.number("force", 0, 1, usual.force);
  tolerance.touch_mm = table.number("touch_mm", 0, 100, usual.touch_mm);
  tolerance.noise_per_mm = table.number("noise_per_mm", 0, 10, usual.noise_per_mm);
  tolerance.marker_mm = table.number("marker_mm", 0, 10, usual.marker_mm);
  tolerance.marker_rad = kRadPerDeg * table.number("marker_deg", 0, 20, usual.marker_rad / kRadPerDeg);
  table.finish();
  return tolerance;
}

/// A scene of the file changes the common one of its name, or is one of its own.
void read_scene(TomlTable table, std::vector<Scene>& scenes) {
  const std::string name = table.text("name");
  auto scene = std::ranges::find(scenes, name, &Scene::name);
  if (scene == scenes.end()) scene = scenes.insert(scene, Scene{.name = name});
  scene->friction = table.number("friction", 0, 2, scene->friction);
  scene->patch_radius_mm = table.number("patch_radius_mm", 0, 100, scene->patch_radius_mm);
  scene->line_share = table.number("line_share", 0, 1, scene->line_share);
  scene->contacts = static_cast<int>(table.integer("contacts", 1, 2, scene->contacts));
  scene->elsewhere = table.flag("elsewhere", scene->elsewhere);
  if (table.has("apart_mm")) scene->apart_mm = ascending_pair(table, "apart_mm", 0, kLargestMm);
  table.finish();
}

}  // namespace

PoseVectorOf<double> pose_noise(const std::array<PoseNoise, kPlates>& noise) {
  PoseVectorOf<double> all;
  for (int p = 0; p < kPlates; ++p) {
    const auto sigmas = noise[static_cast<std::size_t>(p)].standard_deviations();
    all.segment<6>(6 * p) = Eigen::Map<const Eigen::Matrix<double, 6, 1>>(sigmas.data());
  }
  return all.cwiseMax(PoseNoise::kMin);
}

std::vector<Scene> common_scenes() {
  return {{.name = "probe"},
          {.name = "grasp", .friction = 0.6, .patch_radius_mm = 12, .line_share = 0.4},
          {.name = "two", .friction = 0.6, .patch_radius_mm = 12, .line_share = 0.4, .contacts = 2},
          {.name = "elsewhere", .friction = 0.3, .elsewhere = true}};
}

const Scene& FingerSpec::scene(const std::string& wanted) const {
  std::string names;
  for (const Scene& known : scenes) {
    if (known.name == wanted) return known;
    names += (names.empty() ? "" : ", ") + known.name;
  }
  throw InputError(file.string(), "scene", "'" + wanted + "'", "one of " + names);
}

void place_markers(FingerSpec& spec) {
  for (int index = 0; index < kPlates; ++index) {
    PlateSpec& plate = spec.plates[index];
    plate.T_finger_marker.linear() << 1, 0, 0, 0, 0, -1, 0, 1, 0;
    if (spec.surface) continue;  // its position was read from the spec
    const double y_mm = plate_bottom_mm(spec, index);
    const double front_mm = inner_front_mm(spec, y_mm);
    const double depth_mm = inner_back_mm(spec, y_mm) - front_mm;
    plate.T_finger_marker.translation() << inner_half_width_mm(spec, y_mm) * (plate.across[0] + plate.across[1]) / 2,
        y_mm, front_mm + depth_mm * (plate.deep[0] + plate.deep[1]) / 2;
  }
}

namespace {

/// The marker with its white border lies on the lower side of its plate.
void check_markers_on_plates(const FingerSpec& spec) {
  constexpr double kOffPlateMm = 0.1;
  const double half_mm = spec.marker_size_mm * (0.5 + 1.0 / 6);
  for (int index = 0; index < kPlates; ++index) {
    const TriangleSurface& surface = spec.surface->surface;
    for (const auto& [u, v] : {std::pair{0, 0}, {-1, -1}, {1, -1}, {1, 1}, {-1, 1}}) {
      const Eigen::Vector3d at = spec.plates[index].T_finger_marker * Eigen::Vector3d(u * half_mm, v * half_mm, 0);
      const auto& skin = spec.surface->plate_skin[index];
      const bool on_plate = std::any_of(skin.begin(), skin.end(), [&](std::size_t t) {
        auto corner = surface.corners(t);
        const bool level = surface.twice_area(t).normalized().y() < -0.99;
        for (Eigen::Vector3d& x : corner) x = {x.x(), x.z(), x.y()};  // seen from below
        const Eigen::Vector3d share = level ? nearest_in_triangle(corner, at.x(), at.z()) : Eigen::Vector3d::Zero();
        return level && (point_at(corner, share) - Eigen::Vector3d(at.x(), at.z(), at.y())).norm() < kOffPlateMm;
      });
      if (on_plate) continue;
      throw InputError(spec.file.string(), std::string("plates.") + kPlateNames[index] + ".marker_mm",
                       "no level underside of the plate at " + place_text(at),
                       "room for the marker and its white border around it");
    }
  }
}

}  // namespace

std::shared_ptr<const SurfaceFinger> read_surface_unchecked(const std::filesystem::path& file) try {
  TomlTable table = TomlTable::parse_file(file);
  if (!table.has("surface")) return nullptr;
  auto finger = std::make_shared<SurfaceFinger>();
  SurfaceSource& source = finger->source;
  read_surface(table.table("surface"), source);
  TomlTable plates = table.table("plates");
  for (int p = 0; p < kPlates; ++p) {
    try {
      TomlTable plate = plates.table(kPlateNames[p]);
      source.plates[p].box_mm = read_box(plate.table("box"), box_field(p), source);
    } catch (const InputError&) {  // its box stays empty
    }
  }
  finger->surface = read_placed_surface(source);
  return finger;
} catch (const InputError&) {
  return nullptr;
}

FingerSpec read_finger_spec(const std::filesystem::path& file) {
  FingerSpec spec;
  spec.file = file;
  std::string bytes = read_file(file);
  TomlTable table = TomlTable::parse_file(file);
  spec.name = table.text("name");
  const bool in_surface = table.has("surface");
  SurfaceSource source;
  if (in_surface) {
    read_surface(table.table("surface"), source);
    bytes += read_file(source.file);
    spec.surface_file = source.file;
  } else {
    read_shape(table.table("shape"), spec);
  }
  spec.sha256 = sha256_hex(bytes);
  read_material(table.table("material"), spec);
  read_markers(table.table("markers"), spec);
  read_plates(table.table("plates"), spec, in_surface ? &source : nullptr);
  read_camera(table.table("camera"), spec);
  if (in_surface) {
    spec.surface = std::make_shared<const SurfaceFinger>(read_surface_finger(source, file));
    for (const Eigen::Vector3d& at : spec.surface->surface.point_mm) spec.height_mm = std::max(spec.height_mm, at.y());
  }
  spec.scenes = common_scenes();
  if (table.has("scene")) {
    for (TomlTable& scene : table.tables("scene")) read_scene(std::move(scene), spec.scenes);
  }
  read_touch(table.table("touch"), spec);
  if (table.has("tolerance")) spec.tolerance = read_tolerance(table.table("tolerance"));
  table.finish();
  if (!in_surface) check_shape(spec);
  place_markers(spec);
  if (in_surface) check_markers_on_plates(spec);
  check_visibility(spec);
  return spec;
}

void check_made_from(const FingerSpec& spec, const std::string& pack_spec_sha256, const std::filesystem::path& pack) {
  constexpr std::size_t kShown = 12;
  if (spec.sha256 == pack_spec_sha256) return;
  throw InputError(pack.string(), "spec", "one with the SHA-256 " + pack_spec_sha256.substr(0, kShown) + "...",
                   spec.file.string() + " (" + spec.sha256.substr(0, kShown) + "...)");
}

}  // namespace finsight::host
