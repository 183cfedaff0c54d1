#include "hostgen/finger/tetgen.h"

#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <stdexcept>

#include "hostgen/finger/surface.h"
#include "hostgen/util/common.h"
#include "hostgen/util/run_program.h"

namespace finsight::host {

namespace {

/// Reads whitespace-separated numbers with line comments (#), checking every one.
class NumberReader {
 public:
  explicit NumberReader(const std::filesystem::path& file) : name_(file.filename()), text_(read_file(file)) {
    at_ = text_.c_str();
  }
  double number() {
    while (std::strchr(" \t\r\n#", *at_) && *at_) {
      at_ += *at_ == '#' ? std::strcspn(at_, "\n") : 1;
    }
    char* end = nullptr;
    const double value = std::strtod(at_, &end);
    if (end == at_) throw std::runtime_error("tetgen: " + name_ + " ends early or holds no number");
    at_ = end;
    return value;
  }
  int index(int limit) {
    const double value = number();
    if (!(value >= 0 && value < limit)) throw std::runtime_error("tetgen: number out of range in " + name_);
    return static_cast<int>(value);
  }

 private:
  std::string name_, text_;
  const char* at_;
};

constexpr int kLargestCount = 100'000'000;
constexpr std::chrono::seconds kCheckLimit{60};

TetgenOutput read_output(const std::filesystem::path& folder) {
  TetgenOutput out;
  NumberReader nodes(folder / "finger.1.node");
  out.nodes.resize(static_cast<std::size_t>(nodes.index(kLargestCount)));
  nodes.index(4);  // dimension
  const int attributes = nodes.index(100), markers = nodes.index(2);
  for (auto& node : out.nodes) {
    nodes.number();  // its own index
    for (double& coordinate : node) coordinate = nodes.number();
    for (int skipped = 0; skipped < attributes + markers; ++skipped) nodes.number();
  }
  NumberReader tets(folder / "finger.1.ele");
  const int count = tets.index(kLargestCount);
  if (tets.index(100) != 4 || tets.index(100) != 1) {
    throw std::runtime_error("tetgen: expected 4 nodes and one attribute per tetrahedron in finger.1.ele");
  }
  for (int i = 0; i < count; ++i) {
    tets.number();
    std::array<int, 4>& tet = out.tets.emplace_back();
    for (int& node : tet) node = tets.index(static_cast<int>(out.nodes.size()));
    out.region.push_back(tets.index(kLargestCount));
  }
  return out;
}

}  // namespace

TetgenOutput run_tetgen(const std::string& poly, const std::string& switches, std::chrono::milliseconds limit,
                        const std::string& program) {
  const TemporaryFolder folder;
  write_file_atomically(folder.path() / "finger.poly", poly);
  run_program({program, "-" + switches, "finger.poly"}, folder.path(), limit, "tetgen");
  if (!std::filesystem::exists(folder.path() / "finger.1.ele")) throw std::runtime_error(program + " wrote no mesh");
  return read_output(folder.path());
}

std::vector<std::array<int, 3>> find_intersections(const TriangleSurface& surface) {
  Surface input{surface.point_mm, {}, {}};
  for (const auto& corner : surface.triangle) input.facets.push_back({{{corner.begin(), corner.end()}}, {}});
  const TemporaryFolder folder;
  write_file_atomically(folder.path() / "surface.poly", poly_text(input));
  run_program({"tetgen", "-dQ", "surface.poly"}, folder.path(), kCheckLimit, "tetgen");
  std::vector<std::array<int, 3>> triangles;
  if (!std::filesystem::exists(folder.path() / "surface.1.face")) return triangles;  // written only when there are some
  NumberReader faces(folder.path() / "surface.1.face");
  triangles.resize(static_cast<std::size_t>(faces.index(kLargestCount)));
  const int markers = faces.index(2);
  for (auto& triangle : triangles) {
    faces.number();  // its own index
    for (int& point : triangle) point = faces.index(static_cast<int>(surface.point_mm.size()));
    for (int skipped = 0; skipped < markers; ++skipped) faces.number();
  }
  return triangles;
}

}  // namespace finsight::host
