#include "hostgen/finger/surface_finger.h"

#include <algorithm>
#include <map>
#include <sstream>

#include "firmware/input_error.h"
#include "hostgen/finger/front_face.h"

namespace finsight::host {

namespace {

using Eigen::AlignedBox3d;

const std::map<std::string, double> kUnits_mm = {{"mm", 1}, {"cm", 10}, {"m", 1000}, {"inch", 25.4}};
constexpr double kSmallestSideMm = 20, kLargestSideMm = 1000;  // of a finger's largest side
constexpr double kUsualMm = 500;                               // the size that guessed units should give
// Each becomes several tetrahedra, and the board solves for all of them in every frame.
constexpr std::size_t kMaxTriangles = 20'000, kMaxTrianglesBefore = 500'000;  // before simplifying

/// A finger of 0.12 mm was drawn in metres.
void check_size(const TriangleSurface& surface, const SurfaceSource& source, std::size_t most) {
  if (surface.triangle.size() > most) {
    throw InputError(source.file.string(), "surface", std::to_string(surface.triangle.size()) + " triangles",
                     "at most " + std::to_string(most) +
                         ", better some hundreds (surface.simplify_mm takes out what a " + "surface hardly needs)");
  }
  AlignedBox3d bounds;
  for (const Eigen::Vector3d& at : surface.point_mm) bounds.extend(at);
  const Eigen::Vector3d size = bounds.sizes();
  if (size.maxCoeff() >= kSmallestSideMm && size.maxCoeff() <= kLargestSideMm) return;
  std::ostringstream found, guess;
  found << "a bounding box of " << size.x() << " x " << size.y() << " x " << size.z() << " mm in units of \""
        << source.units << "\"";
  for (const auto& [name, unit_mm] : kUnits_mm) {
    const double largest_mm = size.maxCoeff() / kUnits_mm.at(source.units) * unit_mm;
    if (largest_mm < kSmallestSideMm || largest_mm > kUsualMm) continue;
    guess << (guess.str().empty() ? "; are these " : " or ") << "\"" << name << "\" (" << largest_mm << " mm)";
  }
  throw InputError(
      source.file.string(), "size", found.str(),
      "a finger of 20 to 1000 mm" + guess.str() + (guess.str().empty() ? "" : "? Say so as surface.units"));
}

/// The box around the faces that the file has under a name.
AlignedBox3d labelled_box(const TriangleSurface& surface, const std::string& label, const SurfaceSource& source,
                          const std::string& spec, const std::string& field) {
  const auto found = surface.labelled.find(label);
  if (found == surface.labelled.end() || label.empty()) {
    std::string names;
    for (const auto& [name, points] : surface.labelled) {
      if (!name.empty()) names += (names.empty() ? "" : ", ") + name;
    }
    throw InputError(spec, field, "label \"" + label + "\"",
                     "a name of faces in " + source.file.string() + " (" +
                         (names.empty() ? "it has none: OBJ's groups and solids of an ASCII STL have names" : names) +
                         ")");
  }
  AlignedBox3d box;
  for (const int point : found->second) box.extend(surface.point_mm[point]);
  return box;
}

/// Boxes made from labels. Each is a little larger than its faces, by more than the snapping distance, so that rounding
/// puts no face outside its own box; but not where a plate is cut off.
void find_labelled(const TriangleSurface& surface, SurfaceSource& source, const std::string& spec) {
  constexpr double kRoom_mm = 2 * kSnapMm;
  const auto find = [&](const std::string& field, AlignedBox3d& box) {
    const auto label = source.label.find(field);
    if (label == source.label.end()) return false;
    box = labelled_box(surface, label->second, source, spec, field);
    box.min().array() -= kRoom_mm;
    box.max().array() += kRoom_mm;
    return true;
  };
  find("surface.base", source.base_mm);
  find("surface.front", source.front_mm);
  for (int p = 0; p < kPlates; ++p) {
    PlateBox& plate = source.plates[p];
    if (!find(box_field(p), plate.box_mm)) continue;
    (plate.side > 0 ? plate.box_mm.max() : plate.box_mm.min())[plate.axis] -= plate.side * kRoom_mm;
  }
}

void check_boxes_apart(const SurfaceSource& source, const std::string& spec) {
  for (int a = 0; a < kPlates; ++a) {
    const std::string field = box_field(a);
    if (source.plates[a].box_mm.intersects(source.base_mm))
      throw InputError(spec, field, "the base in it", "a plate alone");
    for (int b = 0; b < a; ++b) {
      if (!source.plates[a].box_mm.intersects(source.plates[b].box_mm)) continue;
      throw InputError(spec, field, std::string("a part of the ") + kPlateNames[b] + " plate's box",
                       "boxes that do not overlap");
    }
  }
}

/// Where the touched face may be, for a message.
std::string nearest_front(const TriangleSurface& surface) {
  std::size_t largest = surface.triangle.size();
  double area = 0;
  for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
    if (!faces_front(surface.twice_area(t)) || surface.twice_area(t).norm() <= area) continue;
    area = surface.twice_area(t).norm();
    largest = t;
  }
  if (largest == surface.triangle.size()) return "; none of the whole surface does: are surface.axes right?";
  return "; the largest that does is triangle " + std::to_string(largest + 1) + " around " +
         place_text(surface.middle(largest));
}

}  // namespace

AlignedBox3d SurfaceFinger::plate_bounds_mm(int plate) const {
  AlignedBox3d bounds;
  for (const std::size_t t : plate_skin[plate]) {
    for (const Eigen::Vector3d& corner : surface.corners(t)) bounds.extend(corner);
  }
  return bounds;
}

Surface SurfaceFinger::tetgen_input() const {
  Surface input;
  input.points_mm = surface.point_mm;
  for (const auto& corner : surface.triangle) input.facets.push_back({{{corner.begin(), corner.end()}}, {}});
  input.facets.insert(input.facets.end(), joints.begin(), joints.end());
  return input;
}

std::string box_field(int plate) { return std::string("plates.") + kPlateNames[plate] + ".box"; }

TriangleSurface read_placed_surface(const SurfaceSource& source) {
  TriangleSurface surface = read_triangles(source.file, kUnits_mm.at(source.units));
  for (Eigen::Vector3d& at : surface.point_mm) at = source.R_finger_file * (at - source.origin_mm);
  return surface;
}

SurfaceFinger read_surface_finger(SurfaceSource as_written, const std::filesystem::path& spec_file) {
  const std::string spec = spec_file.string();
  SurfaceFinger finger;
  SurfaceSource& source = finger.source = std::move(as_written);
  TriangleSurface& surface = finger.surface;
  surface = read_placed_surface(source);
  if (source.simplify_mm > 0) {
    check_size(surface, source, kMaxTrianglesBefore);
    check_bounds_a_solid(surface, source.file.string());
    simplify(surface, source.simplify_mm);
  }
  check_size(surface, source, kMaxTriangles);
  check_bounds_a_solid(surface, source.file.string());
  find_labelled(surface, source, spec);
  check_boxes_apart(source, spec);
  if (!source.label.contains("surface.front")) cut_front_at_box(surface, source.front_mm);
  for (const PlateBox& plate : source.plates) snap_to_box(surface, plate.box_mm);
  for (int p = 0; p < kPlates; ++p) {
    finger.joints[p] = cut_at_joined_face(surface, source.plates[p], spec, box_field(p));
  }
  for (int p = 0; p < kPlates; ++p) {
    finger.plate_skin[p] = plate_triangles(surface, source.plates[p], spec, box_field(p));
  }

  const auto in_base = std::count_if(surface.point_mm.begin(), surface.point_mm.end(),
                                     [&](const Eigen::Vector3d& at) { return source.base_mm.contains(at); });
  if (in_base < 3) {
    throw InputError(spec, "surface.base", std::to_string(in_base) + " points of the surface in it",
                     "the part of the finger that is fixed");
  }
  for (const std::size_t t : front_patch(surface.point_mm, surface.triangle, source.front_mm)) {
    finger.front.push_back(surface.triangle[t]);
  }
  if (finger.front.empty()) {
    throw InputError(spec, "surface.front", "no triangle in it that faces -z" + nearest_front(surface),
                     "the face that is touched");
  }
  return finger;
}

}  // namespace finsight::host
