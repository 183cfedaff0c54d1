// VTK's XML format for unstructured grids, ASCII: larger than binary, but readable by anything.
#include <algorithm>
#include <charconv>
#include <functional>
#include <stdexcept>

#include "hostgen/finger/front_face.h"
#include "hostgen/finger/mesh.h"
#include "hostgen/finger/surface_finger.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

class VtuText {
 public:
  void line(const std::string& text) { text_ += text + "\n"; }

  /// One array: `value(i)` for 0 <= i < count, `per_line` of them in a line.
  template <class Value>
  void array(const char* type, const std::string& name, int components, std::size_t count, std::size_t per_line,
             Value value) {
    line("<DataArray type=\"" + std::string(type) + "\" Name=\"" + name + "\" NumberOfComponents=\"" +
         std::to_string(components) + "\" format=\"ascii\">");
    for (std::size_t i = 0; i < count; ++i) {
      char digits[32];  // shortest text that reads back as the same number
      const char* const end = std::to_chars(digits, digits + sizeof digits, value(i)).ptr;
      text_.append(digits, static_cast<std::size_t>(end - digits));
      text_ += (i + 1) % per_line == 0 || i + 1 == count ? '\n' : ' ';
    }
    line("</DataArray>");
  }

  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

std::vector<int> flags(std::size_t size, const std::vector<int>& nodes, int value, std::vector<int> result = {}) {
  result.resize(size);
  for (const int node : nodes) result[node] = value;
  return result;
}

}  // namespace

void write_vtu(const std::filesystem::path& file, const TetMesh& mesh, const std::vector<double>* displacement_mm,
               const std::vector<ForceArrow>& arrows) {
  const std::size_t nodes = mesh.node_mm.size(), tets = mesh.tets.size();
  if (displacement_mm && displacement_mm->size() != 3 * nodes) {
    throw std::invalid_argument("write_vtu: displacement_mm must hold 3 numbers per node");
  }
  // After the mesh's nodes come the tail and head of every arrow, after its tets the arrows' lines.
  const std::size_t points = nodes + 2 * arrows.size(), cells = tets + arrows.size();
  std::vector<double> position, displacement, force(3 * nodes);
  for (const auto& node : mesh.node_mm) position.insert(position.end(), node.begin(), node.end());
  if (displacement_mm) displacement = *displacement_mm;
  for (const ForceArrow& arrow : arrows) {
    const Eigen::Vector3d tail = arrow.point_mm - kArrowMmPerNewton * arrow.force_n;
    for (const Eigen::Vector3d& end : {tail, arrow.point_mm}) {
      position.insert(position.end(), end.begin(), end.end());
      displacement.insert(displacement.end(), arrow.displacement_mm.begin(), arrow.displacement_mm.end());
    }
    force.insert(force.end(), 3, 0.0);
    force.insert(force.end(), arrow.force_n.begin(), arrow.force_n.end());
  }
  std::vector<int> region = mesh.region, connectivity;
  region.resize(cells, -1);
  for (const auto& tet : mesh.tets) connectivity.insert(connectivity.end(), tet.begin(), tet.end());
  for (std::size_t point = nodes; point < points; ++point) connectivity.push_back(static_cast<int>(point));

  const std::vector<int> front = flags(points, mesh.front_nodes, 1), base = flags(points, mesh.base_nodes, 1);
  std::vector<int> plate(points);
  for (int i = 0; i < kPlates; ++i) plate = flags(points, mesh.plate_nodes[i], kFirstPlateRegion + i, std::move(plate));
  const auto entries = [](const auto& values) { return [&values](std::size_t i) { return values[i]; }; };

  VtuText out;
  out.line("<?xml version=\"1.0\"?>");
  out.line("<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\">");
  out.line("<UnstructuredGrid>");
  out.line("<Piece NumberOfPoints=\"" + std::to_string(points) + "\" NumberOfCells=\"" + std::to_string(cells) + "\">");
  out.line("<PointData>");
  out.array("Int32", "front", 1, points, 32, entries(front));
  out.array("Int32", "base", 1, points, 32, entries(base));
  out.array("Int32", "plate", 1, points, 32, entries(plate));
  if (displacement_mm) out.array("Float64", "displacement_mm", 3, 3 * points, 3, entries(displacement));
  if (!arrows.empty()) out.array("Float64", "force_n", 3, 3 * points, 3, entries(force));
  out.line("</PointData>");
  out.line("<CellData>");
  out.array("Int32", "region", 1, cells, 32, entries(region));
  out.line("</CellData>");
  out.line("<Points>");
  out.array("Float64", "position_mm", 3, 3 * points, 3, entries(position));
  out.line("</Points>");
  out.line("<Cells>");
  out.array("Int32", "connectivity", 1, connectivity.size(), 4, entries(connectivity));
  out.array("Int32", "offsets", 1, cells, 16,
            [&](std::size_t i) { return i < tets ? 4 * (i + 1) : 4 * tets + 2 * (i + 1 - tets); });
  out.array("UInt8", "types", 1, cells, 32, [&](std::size_t i) { return i < tets ? 10 : 3; });  // VTK_TETRA, VTK_LINE
  out.line("</Cells>");
  out.line("</Piece>");
  out.line("</UnstructuredGrid>");
  out.line("</VTKFile>");
  write_file_atomically(file, out.text());
}

void write_surface_vtu(const std::filesystem::path& file, const SurfaceFinger& finger) {
  const TriangleSurface& surface = finger.surface;
  const SurfaceSource& source = finger.source;
  std::vector<Eigen::Vector3d> points = surface.point_mm;
  std::vector<int> connectivity, offsets, faces_front, in_front, in_base, plate;
  const auto corners_in = [](const Eigen::AlignedBox3d& box, const std::array<Eigen::Vector3d, 3>& corner) {
    return static_cast<int>(std::ranges::count_if(corner, [&](const Eigen::Vector3d& at) { return box.contains(at); }));
  };
  for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
    connectivity.insert(connectivity.end(), surface.triangle[t].begin(), surface.triangle[t].end());
    offsets.push_back(static_cast<int>(connectivity.size()));
    faces_front.push_back(host::faces_front(surface.twice_area(t)));
    in_front.push_back(corners_in(source.front_mm, surface.corners(t)));
    in_base.push_back(corners_in(source.base_mm, surface.corners(t)));
    plate.push_back(0);
    for (int p = 0; p < kPlates; ++p) {
      if (source.plates[p].box_mm.contains(surface.middle(t))) plate.back() = kFirstPlateRegion + p;
    }
  }
  const auto add_box = [&](const Eigen::AlignedBox3d& box) {
    if (box.isEmpty()) return;
    const auto first = static_cast<int>(points.size());
    for (int c = 0; c < 8; ++c) points.push_back(box.corner(static_cast<Eigen::AlignedBox3d::CornerType>(c)));
    for (int c = 0; c < 8; ++c) {
      for (const int bit : {1, 2, 4}) {
        if (c & bit) continue;
        connectivity.insert(connectivity.end(), {first + c, first + c + bit});
        offsets.push_back(static_cast<int>(connectivity.size()));
        for (auto* values : {&faces_front, &in_front, &in_base}) values->push_back(0);
        plate.push_back(-1);
      }
    }
  };
  add_box(source.base_mm);
  add_box(source.front_mm);
  for (const PlateBox& one : source.plates) add_box(one.box_mm);

  const auto entries = [](const auto& values) { return [&values](std::size_t i) { return values[i]; }; };
  VtuText out;
  out.line("<?xml version=\"1.0\"?>");
  out.line("<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\">");
  out.line("<UnstructuredGrid>");
  out.line("<Piece NumberOfPoints=\"" + std::to_string(points.size()) + "\" NumberOfCells=\"" +
           std::to_string(offsets.size()) + "\">");
  out.line("<CellData>");
  out.array("Int32", "faces_front", 1, offsets.size(), 32, entries(faces_front));
  out.array("Int32", "corners_in_front", 1, offsets.size(), 32, entries(in_front));
  out.array("Int32", "corners_in_base", 1, offsets.size(), 32, entries(in_base));
  out.array("Int32", "plate", 1, offsets.size(), 32, entries(plate));
  out.line("</CellData>");
  out.line("<Points>");
  out.array("Float64", "position_mm", 3, 3 * points.size(), 3,
            [&](std::size_t i) { return points[i / 3][static_cast<Eigen::Index>(i % 3)]; });
  out.line("</Points>");
  out.line("<Cells>");
  out.array("Int32", "connectivity", 1, connectivity.size(), 6, entries(connectivity));
  out.array("Int32", "offsets", 1, offsets.size(), 16, entries(offsets));
  out.array("UInt8", "types", 1, offsets.size(), 32,
            [&](std::size_t i) { return i < surface.triangle.size() ? 5 : 3; });  // VTK_TRIANGLE, VTK_LINE
  out.line("</Cells>");
  out.line("</Piece>");
  out.line("</UnstructuredGrid>");
  out.line("</VTKFile>");
  write_file_atomically(file, out.text());
}

}  // namespace finsight::host
