#include "hostgen/finger/triangle_surface.h"

#include <assimp/scene.h>

#include <assimp/Importer.hpp>
#include <cmath>
#include <map>
#include <sstream>

#include "firmware/input_error.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

/// Numbers points by their coordinates.
class Points {
 public:
  explicit Points(std::vector<Eigen::Vector3d>& points) : points_(points) {}
  int number(const Eigen::Vector3d& at) {
    const auto [place, added] = number_.try_emplace({at.x(), at.y(), at.z()}, static_cast<int>(points_.size()));
    if (added) points_.push_back(at);
    return place->second;
  }

 private:
  std::vector<Eigen::Vector3d>& points_;
  std::map<std::array<double, 3>, int> number_;
};

}  // namespace

std::string place_text(const Eigen::Vector3d& at_mm) {
  std::ostringstream text;
  text << "(" << at_mm.x() << ", " << at_mm.y() << ", " << at_mm.z() << ") mm";
  return text.str();
}

TriangleSurface read_triangles(const std::filesystem::path& file, double unit_mm) {
  const std::string extension = file.extension();
  if (extension != ".stl" && extension != ".ply" && extension != ".obj") {
    throw InputError(file.string(), "extension", "'" + extension + "'", ".stl, .ply or .obj");
  }
  const std::string bytes = read_file(file);
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
      for (std::size_t i = 2; i < corner.size(); ++i) surface.triangle.push_back({corner[0], corner[i - 1], corner[i]});
    }
  }
  if (surface.triangle.empty()) throw InputError(file.string(), "surface", "no triangles", "some");
  return surface;
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
