// The finger spec: everything about a finger that a person decides, read strictly from TOML (hostgen/fingers/*.toml).
#pragma once

#include <Eigen/Geometry>
#include <array>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "firmware/geometry/lens.h"
#include "firmware/types.h"

namespace finsight::host {

struct SurfaceFinger;  // surface_finger.h

/// A quantity that changes linearly with height: value(y) = at_base + slope * y.
struct Taper {
  double at_base_mm = 0;
  double slope = 0;
  double at(double y_mm) const { return at_base_mm + slope * y_mm; }
};

/// How far a plate and its crossbeam move in use, at the middle of the finger (x = 0). The finger is only pushed
/// inward, and everything else grows with that. What must hold "over the working range" is checked at rest and for all
/// plates together at half and at all of it, in every combination of directions.
struct WorkingRange {
  double inward_mm = 0;    ///< along finger +z, away from the touched face
  double sideways_mm = 0;  ///< along finger x, either way
  double tilt_rad = 0;     ///< about finger x and about finger z, either way
  double turn_rad = 0;     ///< about finger y, either way
};

/// One rigid plate with its marker on its lower side. In a parametric finger it hangs under a crossbeam: a plate that
/// reaches a side wall on that side of its crossbeam, any other on a bar of its own from the front wall to the back.
struct PlateSpec {
  double beam_y_mm = 0;            ///< height of the middle of the crossbeam that carries it
  std::array<double, 2> across{};  ///< left and right end, as fractions of the inner half width (-1 ... 1)
  std::array<double, 2> deep{};    ///< front and back end, as fractions of the inner depth (0 front ... 1 back)
  int marker_id = 0;               ///< of DICT_4X4_50
  /// At rest. Origin: middle of the plate's lower face; marker x = finger x, y = finger z, z = finger -y.
  Eigen::Isometry3d T_finger_marker = Eigen::Isometry3d::Identity();
  WorkingRange range;
};

/// Standard deviation of a measured plate motion, per plate: what the touch network is trained against.
struct PoseNoise {
  double lateral_mm = 0;  ///< across the line of sight
  double depth_mm = 0;    ///< along it
  double tilt_rad = 0;    ///< rotation out of the image plane
  double roll_rad = 0;    ///< rotation in the image plane

  static constexpr double kMin =
      1e-6;  ///< mm or rad: smaller ones are raised to this before anything is divided by them

  /// In the order of the plate numbers: displacement x y z, rotation x y z. The camera looks along the finger's y axis:
  /// y is depth, x and z are lateral, rotations about x and z are tilt, about y roll.
  std::array<double, 6> standard_deviations() const {
    return {lateral_mm, depth_mm, lateral_mm, tilt_rad, roll_rad, tilt_rad};
  }
};

/// The standard deviations of all 18 numbers, at least PoseNoise::kMin each.
PoseVectorOf<double> pose_noise(const std::array<PoseNoise, kPlates>& noise);

/// Which contacts occur: what the touch network is trained for, and what a touch is taken for.
struct Scene {
  std::string name;
  double friction = 0;         ///< largest tangential force over normal force, in any direction
  double patch_radius_mm = 0;  ///< largest radius of round patches
  double line_share = 0;       ///< share of touches along a line: an edge or a cylinder; the others are round
  int contacts = 1;            ///< 1, or 2 at once
  std::array<double, 2> apart_mm = {20, 60};  ///< distance of two contacts
  bool elsewhere = false;  ///< not on the touched face but at a side, the back or the tip, each at a point
};

/// What every spec has, whether or not it says so. "probe": one frictionless push at a point, as in the paper. "grasp":
/// objects in a gripper; rubber on dry plastic or metal holds up to a friction of about 0.6 before it slips on a moist
/// or dusty surface, and an object that fills 24 mm of a 47 mm face is large. "two": two such contacts. "elsewhere":
/// pushes that are not at the touched face. The later ones are what no pack of an earlier one can explain.
std::vector<Scene> common_scenes();

/// How much fingers of one spec differ: standard deviations.
struct Tolerance {
  /// Of forces, relative: cast polyurethane of one hardness differs by a fifth from batch to batch, walls and creep add
  /// to it.
  double force = 0.25;
  double touch_mm = 1.5;  ///< radius that holds 68 % of how far touches of one finger are off because of its walls
  /// Plates of other fingers move a little otherwise under the same touch: as if each mm of their motion added so many
  /// times the spec's noise.
  double noise_per_mm = 0.2;
  double marker_mm = 0.3;      ///< along each axis, of a marker stuck on by hand
  double marker_rad = 0.0175;  ///< about each axis; one degree
};

struct FingerSpec {
  std::filesystem::path file, surface_file;  ///< it was read from these; a parametric finger has no surface file
  std::string name;
  std::string sha256;  ///< of the spec file's bytes, and of the surface file's after them

  // Shape, all lengths in mm: a surface from a file, or numbers. With a surface, only height and half_width of the
  // numbers are set, and the latter is that of the touched part.
  std::shared_ptr<const SurfaceFinger> surface;
  // Planes and edges are straight lines over the height y.
  double height_mm = 0;
  Taper front_z, back_z, half_width;  ///< outer faces: z of the touched face, z of the back, x of the sides
  double front_wall_mm = 0, back_wall_mm = 0;
  double side_wall_mm = 0;  ///< width of the posts and bars at the open sides
  double base_ring_mm = 0, top_mm = 0, beam_mm = 0, plate_mm = 0;
  std::array<PlateSpec, kPlates> plates;  ///< top, middle, low
  double marker_size_mm = 0;              ///< side of the marker's black square; around it one module (1/6) stays white

  // Material (paper, section 2.1)
  double youngs_modulus_mpa = 0, poisson_ratio = 0;
  double density_kg_m3 = 0;
  double plate_stiffness_ratio = 0;  ///< the rigid plates are modelled this many times stiffer than the finger

  // Camera (OpenCV's frame: x right, y down in the image, z along the line of sight)
  Eigen::Isometry3d T_finger_camera = Eigen::Isometry3d::Identity();
  std::array<Lens, 2> cameras;  ///< its lens, for images of 1280x720 and 640x480
  std::array<PoseNoise, kPlates> noise;
  Tolerance tolerance;

  // Touch
  std::array<double, 2> touch_y_mm{};  ///< lowest and highest touched point of the front face
  double touch_edge_mm = 0;            ///< distance of the touched points from the side edges
  std::array<double, 2> force_n{};     ///< lowest and highest force
  double threshold_mm = 0;             ///< plate motion below which no touch is published
  double rated_deformation_mm = 0;     ///< RMS front-face displacement that counts as 1000 per mille
  std::vector<Scene> scenes;           ///< the common ones, changed and joined by the file's
  std::string trained_scene;           ///< what a pack is made for unless something else is asked for

  /// Throws InputError naming the scenes that there are.
  const Scene& scene(const std::string& wanted) const;
};

/// The surface that a spec names and the boxes around its parts, as far as they can be read and unchecked, for a
/// picture of what is wrong; nothing for a parametric finger, or if there is no surface to show.
std::shared_ptr<const SurfaceFinger> read_surface_unchecked(const std::filesystem::path& file);

/// Throws InputError for unknown keys, wrong types, numbers or a surface that cannot be a finger, and a camera that
/// does not see all markers (with the reason).
FingerSpec read_finger_spec(const std::filesystem::path& file);
/// Throws InputError if a pack was made from another spec, whose SHA-256 it holds.
void check_made_from(const FingerSpec& spec, const std::string& pack_spec_sha256, const std::filesystem::path& pack);

}  // namespace finsight::host
