// Spec -> closed surface -> tetrahedra. The only folder that runs TetGen.
#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "hostgen/finger/spec.h"

namespace finsight::host {

/// Labels of tetrahedra: the soft body, then one per rigid plate.
inline constexpr int kBodyRegion = 0;
inline constexpr int kFirstPlateRegion = 1;  ///< + plate index (top, middle, low)

struct TetMesh {
  std::vector<std::array<double, 3>> node_mm;         ///< finger frame, undeformed
  std::vector<std::array<int, 4>> tets;               ///< positively oriented: det(x1-x0, x2-x0, x3-x0) > 0
  std::vector<int> region;                            ///< per tet
  std::vector<int> front_nodes;                       ///< on the touched face, ascending
  std::vector<int> base_nodes;                        ///< on the base plane y = 0 or in the base box, ascending
  std::array<std::vector<int>, kPlates> plate_nodes;  ///< of the rigid plates, ascending
  double min_dihedral_deg = 0;
};

enum class MeshSize { kCoarse, kDefault, kMedium, kFine, kFinest };  ///< about 2k, 3-4k, 6k, 16k, 60k tets

/// Meshes the finger. The same spec gives the same bytes. Throws InputError (surface cannot be closed: the reason) and
/// std::runtime_error (tetgen missing, failed or over its time limit).
TetMesh make_mesh(const FingerSpec& spec, MeshSize size = MeshSize::kDefault);

/// The worst tetrahedra (smallest dihedral angle and place, no two nearer than 5 mm) and what to do about them or about
/// a mesh that is large, in lines for people; empty if there is nothing to say.
std::string mesh_advice(const TetMesh& mesh);

/// The triangles of the touched face as mesh node indices, counter-clockwise seen from outside (from -z), in the order
/// of the tets that own them.
std::vector<std::array<int, 3>> front_triangles(const TetMesh& mesh);

/// All triangles of the outside, wound so that (x1 - x0) x (x2 - x0) points away from the finger, in the order of the
/// tets.
std::vector<std::array<int, 3>> boundary_triangles(const TetMesh& mesh);

/// Exactly `count` >= 1 points spread evenly over the part of the undeformed front face that is touched (the spec's
/// touch section), its border included. They lie on the face, in rows from the lowest up; not on mesh nodes.
std::vector<Vec3f> touch_points(const FingerSpec& spec, int count);

/// Checks that both images show all markers whole, each with its white border of one module: projects plates, beams
/// and walls for the rest pose and for the corners of the working range of plate motions. Throws InputError naming the
/// plate and what hides it. read_finger_spec() does it.
void check_visibility(const FingerSpec& spec);

/// A force drawn as a line that ends at a point of the undeformed face, and moves with it.
struct ForceArrow {
  Eigen::Vector3d point_mm = Eigen::Vector3d::Zero(), displacement_mm = Eigen::Vector3d::Zero();
  Eigen::Vector3d force_n = Eigen::Vector3d::Zero();
};
/// Length of an arrow's line.
inline constexpr double kArrowMmPerNewton = 5;

/// Writes a surface as a .vtu of triangles: cell arrays "faces_front" (1: within 60 degrees of -z), "corners_in_front"
/// and "corners_in_base" (0 to 3: how many lie in that box), "plate" (0, or the region of the plate whose box holds the
/// triangle's middle). The boxes are lines of plate -1.
void write_surface_vtu(const std::filesystem::path& file, const SurfaceFinger& finger);

/// Writes a .vtu (ASCII XML) that ParaView opens: cell array "region", point arrays "front" and "base" (0 or 1),
/// "plate" (0 none, else the plate's region), and "displacement_mm" if given ([3 * nodes]). Arrows are line cells of
/// region -1 after the tets; then there is a point array "force_n", zero but at their heads.
void write_vtu(const std::filesystem::path& file, const TetMesh& mesh,
               const std::vector<double>* displacement_mm = nullptr, const std::vector<ForceArrow>& arrows = {});

}  // namespace finsight::host
