// VTK's XML format for unstructured grids, ASCII: larger than binary, but readable by anything.
#include <charconv>
#include <functional>
#include <stdexcept>

#include "hostgen/common.h"
#include "hostgen/finger/mesh.h"

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
      text_.append(digits, std::to_chars(digits, digits + sizeof digits, value(i)).ptr);
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

void write_vtu(const std::filesystem::path& file, const TetMesh& mesh, const std::vector<double>* displacement_mm) {
  const std::size_t nodes = mesh.node_mm.size(), tets = mesh.tets.size();
  if (displacement_mm && displacement_mm->size() != 3 * nodes) {
    throw std::invalid_argument("write_vtu: displacement_mm must hold 3 numbers per node");
  }
  const std::vector<int> front = flags(nodes, mesh.front_nodes, 1), base = flags(nodes, mesh.base_nodes, 1);
  std::vector<int> plate(nodes);
  for (int i = 0; i < kPlates; ++i) plate = flags(nodes, mesh.plate_nodes[i], kFirstPlateRegion + i, std::move(plate));
  const auto entries = [](const std::vector<int>& values) { return [&values](std::size_t i) { return values[i]; }; };

  VtuText out;
  out.line("<?xml version=\"1.0\"?>");
  out.line("<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\">");
  out.line("<UnstructuredGrid>");
  out.line("<Piece NumberOfPoints=\"" + std::to_string(nodes) + "\" NumberOfCells=\"" + std::to_string(tets) + "\">");
  out.line("<PointData>");
  out.array("Int32", "front", 1, nodes, 32, entries(front));
  out.array("Int32", "base", 1, nodes, 32, entries(base));
  out.array("Int32", "plate", 1, nodes, 32, entries(plate));
  if (displacement_mm) {
    out.array("Float64", "displacement_mm", 3, 3 * nodes, 3, [&](std::size_t i) { return (*displacement_mm)[i]; });
  }
  out.line("</PointData>");
  out.line("<CellData>");
  out.array("Int32", "region", 1, tets, 32, entries(mesh.region));
  out.line("</CellData>");
  out.line("<Points>");
  out.array("Float64", "position_mm", 3, 3 * nodes, 3, [&](std::size_t i) { return mesh.node_mm[i / 3][i % 3]; });
  out.line("</Points>");
  out.line("<Cells>");
  out.array("Int32", "connectivity", 1, 4 * tets, 4, [&](std::size_t i) { return mesh.tets[i / 4][i % 4]; });
  out.array("Int32", "offsets", 1, tets, 16, [](std::size_t i) { return 4 * (i + 1); });
  out.array("UInt8", "types", 1, tets, 32, [](std::size_t) { return 10; });  // VTK_TETRA
  out.line("</Cells>");
  out.line("</Piece>");
  out.line("</UnstructuredGrid>");
  out.line("</VTKFile>");
  write_file_atomically(file, out.text());
}

}  // namespace finsight::host
