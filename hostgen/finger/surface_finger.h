// A finger whose shape comes from a file: a closed surface, and boxes (or names of faces in the file) that mark its
// plates, base and front.
#pragma once

#include <array>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "firmware/types.h"
#include "hostgen/finger/plate_cut.h"

namespace finsight::host {

/// What the spec says about it. Boxes are in the finger frame.
struct SurfaceSource {
  std::filesystem::path file;
  std::string units;  ///< of the file's numbers: "mm", "cm", "m" or "inch"
  Eigen::Matrix3d R_finger_file = Eigen::Matrix3d::Identity();
  Eigen::Vector3d origin_mm = Eigen::Vector3d::Zero();  ///< of the finger frame, in the file's axes
  std::array<PlateBox, kPlates> plates;                 ///< top, middle, low
  Eigen::AlignedBox3d base_mm, front_mm;
  double simplify_mm = 0;  ///< how far the surface may move to become simpler: see simplify()
  /// Boxes given by a label, which names faces in the file: field of the spec ("surface.base") -> label.
  std::map<std::string, std::string> label;
};

struct SurfaceFinger {
  SurfaceSource source;
  TriangleSurface surface;                                   ///< finger frame; cut where plates are joined to the body
  std::array<Facet, kPlates> joints;                         ///< between plate and body
  std::array<std::vector<std::size_t>, kPlates> plate_skin;  ///< triangles of each plate, ascending
  std::vector<std::array<int, 3>> front;                     ///< triangles of the touched face

  Eigen::AlignedBox3d plate_bounds_mm(int plate) const;
  /// Everything that TetGen needs except region seeds: the boxes tell which regions are the plates.
  Surface tetgen_input() const;
};

/// The spec's field of a plate's box.
std::string box_field(int plate);

/// The triangles of the source's file in the finger frame, unchecked. Throws InputError if it cannot be read.
TriangleSurface read_placed_surface(const SurfaceSource& source);

/// Reads and checks the surface. Throws InputError, naming the surface's file or the field of `spec_file`.
SurfaceFinger read_surface_finger(SurfaceSource source, const std::filesystem::path& spec_file);

}  // namespace finsight::host
