// A jig that a user prints: a clip for the finger's base that holds guides for a pin over the touched face. Weights on
// the pin press the face at known places, along a known direction.
#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <vector>

#include "hostgen/finger/jig_holes.h"
#include "hostgen/finger/triangle_surface.h"

namespace finsight::host {

/// What the jig is fitted to, in its own frame: x as the finger's, z along the guides into the finger, y the rest.
struct JigFit {
  Eigen::Isometry3d T_finger_jig = Eigen::Isometry3d::Identity();
  double base_y_mm = 0, clip_mm = 0;  ///< finger frame: the clip grips from the base to this much above it
  double left_mm = 0, right_mm = 0;   ///< x of the gripped part's sides
  double face_z_mm = 0, seat_z_mm = 0, back_z_mm = 0;  ///< nearest point of the face, of the gripped part, its back
  double slab_z_mm = 0, print_bed_z_mm = 0;            ///< the slab's two faces: towards the finger, and away from it
  std::vector<JigHole> holes;                          ///< finger frame
};

struct Jig {
  JigFit fit;
  TriangleSurface surface;  ///< as it is printed: the slab's outer face on z = 0, holes upright
};

/// A slab over the face with a guide at every one of jig_holes(), numbered on its outer face in grooves, and two cheeks
/// that snap around the base. One solid; nothing hangs over by more than 45 degrees when it is printed as it lies.
/// Throws InputError if the finger leaves no room for it.
Jig make_jig(const FingerSpec& spec);

/// Binary STL, in mm.
void write_stl(const std::filesystem::path& file, const TriangleSurface& surface);

/// Front and side view with numbers and dimensions, how to hang it, and where the holes are: millimetres on paper, 1:1.
void draw_jig(const std::filesystem::path& svg, const FingerSpec& spec, const Jig& jig);

}  // namespace finsight::host
