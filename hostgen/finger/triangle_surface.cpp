#include "hostgen/finger/triangle_surface.h"

#include <assimp/scene.h>

#include <algorithm>
#include <assimp/Importer.hpp>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <map>
#include <sstream>

#include "firmware/input_error.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

/// Numbers points; those nearer than kWeldMm to an earlier one are that.
class Points {
 public:
  explicit Points(std::vector<Eigen::Vector3d>& points) : points_(points) {}
  int number(const Eigen::Vector3d& at) {
    const Cell here = cell(at);
    for (int turn = 0; turn < 27; ++turn) {
      const int near = (turn + 13) % 27;  // the point's own cell first
      const auto found = number_.find({here[0] + near % 3 - 1, here[1] + near / 3 % 3 - 1, here[2] + near / 9 - 1});
      if (found == number_.end()) continue;
      for (const int point : found->second) {
        if ((points_[static_cast<std::size_t>(point)] - at).norm() <= kWeldMm) return point;
      }
    }
    number_[here].push_back(static_cast<int>(points_.size()));
    points_.push_back(at);
    return static_cast<int>(points_.size()) - 1;
  }

 private:
  using Cell = std::array<long, 3>;
  static Cell cell(const Eigen::Vector3d& at) {
    const auto along = [&](int axis) { return std::lround(at[axis] / kWeldMm); };
    return {along(0), along(1), along(2)};
  }
  std::vector<Eigen::Vector3d>& points_;
  std::map<Cell, std::vector<int>> number_;
};

/// A binary STL says how many triangles it has.
void check_stl_is_whole(const std::string& bytes, const std::filesystem::path& file) {
  constexpr std::size_t kHeader = 80, kCount = 4, kTriangle = 50;
  if (bytes.starts_with("solid")) return;
  if (bytes.size() < kHeader + kCount) {
    throw InputError(file.string(), "size", std::to_string(bytes.size()) + " bytes",
                     "84 or more (binary), or a text that begins with \"solid\"");
  }
  std::uint32_t triangles = 0;
  std::memcpy(&triangles, bytes.data() + kHeader, kCount);
  const std::size_t whole = kHeader + kCount + kTriangle * triangles;
  if (bytes.size() >= whole) return;
  throw InputError(file.string(), "size", std::to_string(bytes.size()) + " bytes",
                   std::to_string(whole) + " for its " + std::to_string(triangles) + " triangles");
}

}  // namespace

std::string place_text(const Eigen::Vector3d& at_mm) {
  std::ostringstream text;
  text << "(" << at_mm.x() << ", " << at_mm.y() << ", " << at_mm.z() << ") mm";
  return text.str();
}

TriangleSurface read_triangles(const std::filesystem::path& file, double unit_mm) {
  std::string extension = file.extension();
  std::ranges::transform(extension, extension.begin(), [](unsigned char c) { return std::tolower(c); });
  if (extension != ".stl" && extension != ".ply" && extension != ".obj") {
    throw InputError(file.string(), "extension", "'" + extension + "'", ".stl, .ply or .obj");
  }
  const std::string bytes = read_file(file);
  if (extension == ".stl") check_stl_is_whole(bytes, file);
  Assimp::Importer importer;
  const aiScene* scene = importer.ReadFileFromMemory(bytes.data(), bytes.size(), 0, extension.c_str() + 1);
  if (!scene)
    throw InputError(file.string(), "is damaged or not a " + extension + " file: " + importer.GetErrorString());
  TriangleSurface surface;
  Points points(surface.point_mm);
  for (unsigned m = 0; m < scene->mNumMeshes; ++m) {  // OBJ's groups and STL's solids are one surface
    const aiMesh& mesh = *scene->mMeshes[m];
    std::vector<int>& labelled = surface.labelled[mesh.mName.C_Str()];
    for (unsigned f = 0; f < mesh.mNumFaces; ++f) {
      std::vector<int> corner;
      for (unsigned i = 0; i < mesh.mFaces[f].mNumIndices; ++i) {
        const aiVector3D& at = mesh.mVertices[mesh.mFaces[f].mIndices[i]];
        if (!std::isfinite(at.x) || !std::isfinite(at.y) || !std::isfinite(at.z)) {
          throw InputError(file.string(), "face " + std::to_string(f + 1), "a coordinate that is not finite",
                           "finite coordinates");
        }
        corner.push_back(points.number(unit_mm * Eigen::Vector3d(at.x, at.y, at.z)));
      }
      labelled.insert(labelled.end(), corner.begin(), corner.end());
      for (std::size_t i = 2; i < corner.size(); ++i) {
        const std::array<int, 3> triangle = {corner[0], corner[i - 1], corner[i]};
        const bool welded = triangle[0] == triangle[1] || triangle[1] == triangle[2] || triangle[2] == triangle[0];
        if (!welded) surface.triangle.push_back(triangle);
      }
    }
  }
  if (surface.triangle.empty()) throw InputError(file.string(), "surface", "no triangles", "some");
  return surface;
}

std::string hardness_text(const TriangleSurface& surface) {
  double shortest_mm = std::numeric_limits<double>::infinity(), thinnest = shortest_mm;
  Eigen::Vector3d short_at = Eigen::Vector3d::Zero(), thin_at = short_at;
  for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
    const auto corner = surface.corners(t);
    double longest_mm = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      const Eigen::Vector3d edge = corner[(i + 1) % 3] - corner[i];
      longest_mm = std::max(longest_mm, edge.norm());
      if (edge.norm() >= shortest_mm) continue;
      shortest_mm = edge.norm();
      short_at = corner[i];
    }
    const double thin = surface.twice_area(t).norm() / (longest_mm * longest_mm);
    if (thin >= thinnest) continue;
    thinnest = thin;
    thin_at = surface.middle(t);
  }
  std::ostringstream text;
  text.precision(2);
  text << surface.triangle.size() << " triangles, the shortest edge " << shortest_mm << " mm at "
       << place_text(short_at) << ", the thinnest triangle 1:" << std::lround(1 / thinnest) << " around "
       << place_text(thin_at);
  return text.str();
}

double winding_number(const TriangleSurface& surface, const Eigen::Vector3d& at_mm) {
  constexpr double kWholeSphere = 4 * 3.14159265358979323846;
  double solid_angle = 0;
  for (std::size_t t = 0; t < surface.triangle.size(); ++t) {
    std::array<Eigen::Vector3d, 3> to = surface.corners(t);
    for (Eigen::Vector3d& corner : to) corner -= at_mm;
    const double a = to[0].norm(), b = to[1].norm(), c = to[2].norm();
    const double above = to[0].dot(to[1].cross(to[2]));
    solid_angle +=
        2 * std::atan2(above, a * b * c + to[0].dot(to[1]) * c + to[1].dot(to[2]) * a + to[2].dot(to[0]) * b);
  }
  return solid_angle / kWholeSphere;
}

}  // namespace finsight::host
