// Spec -> surface (of a grid, or from a file) -> TetGen, then made into what the solvers rely on: right-handed tets, no
// unused nodes, and the node sets (touched face, base, plates) found from the planes, boxes and regions that define
// them.
#include "hostgen/finger/mesh.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>
#include <sstream>
#include <stdexcept>

#include "hostgen/finger/front_face.h"
#include "hostgen/finger/grid.h"
#include "hostgen/finger/plate_geometry.h"
#include "hostgen/finger/surface.h"
#include "hostgen/finger/surface_finger.h"
#include "hostgen/finger/tetgen.h"
#include "hostgen/util/common.h"

namespace finsight::host {

namespace {

constexpr std::chrono::seconds kTetgenLimit{30};  // the fine mesh takes a second; sometimes TetGen never ends
constexpr double kOnPlaneMm = 1e-6;

/// q: largest radius-edge ratio / smallest dihedral angle aimed at; a: largest volume, mm^3; A: regions; Q: quiet; T:
/// what counts as coplanar (at its default, 1e-8, TetGen 1.5 aborts on fingers that it meshes well with 1e-9 ...
/// 1e-13). Without a volume the walls' thickness and the ratio decide the number of tets.
const char* switches(MeshSize size) {
  switch (size) {
    case MeshSize::kCoarse:
      return "pq3/5AQT1e-10";
    case MeshSize::kDefault:
      return "pq1.4/15AQT1e-10";
    case MeshSize::kFinest:
      return "pq1.4/15a3.5AQT1e-10";
    case MeshSize::kFine:
      return "pq1.4/15a20AQT1e-10";
    case MeshSize::kMedium:
      return "pq1.4/15a70AQT1e-10";
  }
  throw std::logic_error("unknown mesh size");
}

Eigen::Vector3d at(const TetMesh& mesh, int node) {
  return Eigen::Map<const Eigen::Vector3d>(mesh.node_mm[node].data());
}

/// Faces of a positively oriented tet, counter-clockwise seen from outside; face i lies opposite corner i.
constexpr int kFaces[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};

void orient(TetMesh& mesh) {
  for (auto& tet : mesh.tets) {
    const Eigen::Vector3d a = at(mesh, tet[0]);
    const double volume = (at(mesh, tet[1]) - a).dot((at(mesh, tet[2]) - a).cross(at(mesh, tet[3]) - a));
    if (volume == 0) throw std::runtime_error("tetgen made a tetrahedron without volume");
    if (volume < 0) std::swap(tet[2], tet[3]);
  }
}

void drop_unused_nodes(TetMesh& mesh) {
  std::vector<int> new_index(mesh.node_mm.size(), -1);
  for (const auto& tet : mesh.tets) {
    for (const int node : tet) new_index[node] = 0;
  }
  int used = 0;
  for (std::size_t node = 0; node < new_index.size(); ++node) {
    if (new_index[node] < 0) continue;
    mesh.node_mm[used] = mesh.node_mm[node];
    new_index[node] = used++;
  }
  mesh.node_mm.resize(used);
  for (auto& tet : mesh.tets) {
    for (int& node : tet) node = new_index[node];
  }
}

void sort_out(std::vector<int>& nodes) {
  std::sort(nodes.begin(), nodes.end());
  nodes.erase(std::unique(nodes.begin(), nodes.end()), nodes.end());
}

/// Touched face and base from the planes that define them.
void find_faces(TetMesh& mesh, const FingerSpec& spec) {
  for (int node = 0; node < static_cast<int>(mesh.node_mm.size()); ++node) {
    const auto [x, y, z] = mesh.node_mm[node];
    if (std::abs(z - spec.front_z.at(y)) < kOnPlaneMm) mesh.front_nodes.push_back(node);
    if (std::abs(y) < kOnPlaneMm) mesh.base_nodes.push_back(node);
  }
}

/// Touched face and base from the boxes that define them.
void find_faces(TetMesh& mesh, const SurfaceFinger& finger) {
  std::vector<Eigen::Vector3d> points;
  for (int node = 0; node < static_cast<int>(mesh.node_mm.size()); ++node) {
    points.push_back(at(mesh, node));
    if (finger.source.base_mm.exteriorDistance(points.back()) < kOnPlaneMm) mesh.base_nodes.push_back(node);
  }
  const auto boundary = boundary_triangles(mesh);
  for (const std::size_t t : front_patch(points, boundary, finger.source.front_mm)) {
    mesh.front_nodes.insert(mesh.front_nodes.end(), boundary[t].begin(), boundary[t].end());
  }
  sort_out(mesh.front_nodes);
}

void find_plate_nodes(TetMesh& mesh) {
  for (std::size_t i = 0; i < mesh.tets.size(); ++i) {
    if (mesh.region[i] < kFirstPlateRegion) continue;
    std::vector<int>& nodes = mesh.plate_nodes[mesh.region[i] - kFirstPlateRegion];
    nodes.insert(nodes.end(), mesh.tets[i].begin(), mesh.tets[i].end());
  }
  for (std::vector<int>& nodes : mesh.plate_nodes) sort_out(nodes);
}

double smallest_dihedral_deg(const TetMesh& mesh, const std::array<int, 4>& tet) {
  double largest_cosine = -1;  // of the six angles
  Eigen::Vector3d normal[4];
  for (int face = 0; face < 4; ++face) {
    const Eigen::Vector3d a = at(mesh, tet[kFaces[face][0]]);
    normal[face] = (at(mesh, tet[kFaces[face][1]]) - a).cross(at(mesh, tet[kFaces[face][2]]) - a).normalized();
  }
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < i; ++j) largest_cosine = std::max(largest_cosine, -normal[i].dot(normal[j]));
  }
  return std::acos(std::min(1.0, largest_cosine)) * 180 / std::numbers::pi;
}

double min_dihedral_deg(const TetMesh& mesh) {
  double smallest = 180;
  for (const auto& tet : mesh.tets) smallest = std::min(smallest, smallest_dihedral_deg(mesh, tet));
  return smallest;
}

/// What one of TetGen's regions is, by the centre of its largest tet: a region is cut off by the plates' boxes, so any
/// of its points would do. Nothing if it is a closed hollow.
std::optional<int> region_at(const SurfaceFinger& finger, const Eigen::Vector3d& middle) {
  for (int plate = 0; plate < kPlates; ++plate) {
    if (finger.source.plates[plate].box_mm.contains(middle)) return kFirstPlateRegion + plate;
  }
  if (winding_number(finger.surface, middle) < 0.5) return std::nullopt;
  return kBodyRegion;
}

/// Gives TetGen's regions the numbers of ours and drops what fills hollows.
void name_regions(TetgenOutput& raw, const SurfaceFinger& finger) {
  std::map<int, std::pair<double, Eigen::Vector3d>> largest;  // tet of a region: volume, middle
  for (std::size_t t = 0; t < raw.tets.size(); ++t) {
    Eigen::Matrix<double, 3, 4> corner;
    for (int i = 0; i < 4; ++i) corner.col(i) = Eigen::Map<const Eigen::Vector3d>(raw.nodes[raw.tets[t][i]].data());
    const double volume = std::abs((corner.rightCols<3>().colwise() - corner.col(0)).determinant());
    auto& best = largest[raw.region[t]];
    if (volume > best.first) best = {volume, corner.rowwise().mean()};
  }
  std::map<int, std::optional<int>> ours;
  for (const auto& [region, tet] : largest) ours[region] = region_at(finger, tet.second);
  std::size_t kept = 0;
  for (std::size_t t = 0; t < raw.tets.size(); ++t) {
    const std::optional<int> region = ours.at(raw.region[t]);
    if (!region) continue;
    raw.tets[kept] = raw.tets[t];
    raw.region[kept++] = *region;
  }
  raw.tets.resize(kept);
  raw.region.resize(kept);
}

/// Says why a surface may be too hard to fill.
TetgenOutput filled(const FingerSpec& spec, const std::string& poly, MeshSize size) try {
  return run_tetgen(poly, switches(size), kTetgenLimit);
} catch (const Interrupted&) {
  throw;
} catch (const std::runtime_error& error) {
  if (!spec.surface) throw;
  throw std::runtime_error(std::string(error.what()) + "\n" + spec.surface_file.string() + ": " +
                           hardness_text(spec.surface->surface) +
                           "; surface.simplify_mm (0.1, or more) takes out what the surface hardly needs");
}

}  // namespace

TetMesh make_mesh(const FingerSpec& spec, MeshSize size) {
  if (!spec.surface) check_shape(spec);
  const Surface surface = finger_surface(spec);
  TetgenOutput raw = filled(spec, poly_text(surface), size);
  if (spec.surface) name_regions(raw, *spec.surface);
  TetMesh mesh;
  mesh.node_mm = std::move(raw.nodes);
  mesh.tets = std::move(raw.tets);
  mesh.region = std::move(raw.region);
  if (mesh.tets.empty()) throw std::runtime_error("tetgen made no tetrahedra");
  if (*std::max_element(mesh.region.begin(), mesh.region.end()) >= kFirstPlateRegion + kPlates) {
    throw std::runtime_error("tetgen filled a hollow of the finger: its surface is not closed");
  }
  orient(mesh);
  drop_unused_nodes(mesh);
  if (spec.surface) {
    find_faces(mesh, *spec.surface);
  } else {
    find_faces(mesh, spec);
  }
  find_plate_nodes(mesh);
  mesh.min_dihedral_deg = min_dihedral_deg(mesh);
  return mesh;
}

std::string mesh_advice(const TetMesh& mesh) {
  constexpr double kGood_deg = 5, kApart_mm = 5;
  constexpr std::size_t kMany = 20'000, kPlaces = 3;
  std::vector<std::pair<double, std::size_t>> bad;
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    const double angle_deg = smallest_dihedral_deg(mesh, mesh.tets[t]);
    if (angle_deg < kGood_deg) bad.emplace_back(angle_deg, t);
  }
  std::sort(bad.begin(), bad.end());
  std::vector<Eigen::Vector3d> places;
  std::ostringstream text;
  text.precision(2);
  for (const auto& [angle_deg, t] : bad) {
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();
    for (const int node : mesh.tets[t]) middle += at(mesh, node) / 4;
    if (std::ranges::any_of(places, [&](const auto& other) { return (other - middle).norm() < kApart_mm; })) continue;
    text << (places.empty() ? std::to_string(bad.size()) + " tets below 5 deg, the worst " : ", ") << angle_deg
         << " deg at " << place_text((10 * middle).array().round() / 10);
    places.push_back(middle);
    if (places.size() == kPlaces) break;
  }
  if (!places.empty()) text << "\n";
  if (!places.empty() || mesh.tets.size() > kMany) {
    text << "slivers and short edges of the surface make many and bad tets: surface.simplify_mm (0.1, or more) takes "
            "out what the surface hardly needs\n";
  }
  return text.str();
}

// The faces that only one tet has.
std::vector<std::array<int, 3>> boundary_triangles(const TetMesh& mesh) {
  std::map<std::array<int, 3>, std::pair<std::array<int, 3>, int>> faces;  // by nodes in order: itself, how many
  std::vector<std::array<int, 3>> keys;                                    // in the order of their tets
  for (const auto& tet : mesh.tets) {
    for (const auto& face : kFaces) {
      const std::array<int, 3> nodes = {tet[face[0]], tet[face[1]], tet[face[2]]};
      std::array<int, 3> key = nodes;
      std::sort(key.begin(), key.end());
      const auto [place, added] = faces.try_emplace(key, nodes, 0);
      ++place->second.second;
      if (added) keys.push_back(key);
    }
  }
  std::vector<std::array<int, 3>> boundary;
  for (const auto& key : keys) {
    const auto& [nodes, count] = faces.at(key);
    if (count == 1) boundary.push_back(nodes);
  }
  return boundary;
}

std::vector<std::array<int, 3>> front_triangles(const TetMesh& mesh) {
  std::vector<std::array<int, 3>> triangles;
  const auto on_front = [&](int node) {
    return std::binary_search(mesh.front_nodes.begin(), mesh.front_nodes.end(), node);
  };
  for (const auto& [a, b, c] : boundary_triangles(mesh)) {
    if (!on_front(a) || !on_front(b) || !on_front(c)) continue;
    // Three nodes of a curved face's rim may also be a triangle of the side.
    if (faces_front((at(mesh, b) - at(mesh, a)).cross(at(mesh, c) - at(mesh, a)))) triangles.push_back({a, b, c});
  }
  return triangles;
}

std::vector<Vec3f> touch_points(const FingerSpec& spec, int count) {
  if (count < 1) throw std::invalid_argument("touch_points: count must be at least 1");
  const auto half_width = [&](double y) { return spec.half_width.at(y) - spec.touch_edge_mm; };
  const double lowest = spec.touch_y_mm[0], highest = spec.touch_y_mm[1];
  const double height = highest - lowest;
  // Rows are as far apart as the points within a row, and each gets points in proportion to its width. The running
  // total is what is rounded, so that the counts add up.
  const double mean_width = half_width(lowest) + half_width(highest);
  const int rows = std::clamp(static_cast<int>(std::lround(std::sqrt(count * height / mean_width))), 1, count);
  const auto row_y = [&](int row) { return rows == 1 ? lowest + height / 2 : lowest + height * row / (rows - 1); };
  double sum_of_widths = 0;
  for (int row = 0; row < rows; ++row) sum_of_widths += half_width(row_y(row));
  std::vector<Vec3f> points;
  double before = 0;
  for (int row = 0; row < rows; ++row) {
    const double y = row_y(row), half = half_width(y);
    before += half;
    const int last = row == rows - 1 ? count : static_cast<int>(std::lround(count * before / sum_of_widths));
    const int in_row = last - static_cast<int>(points.size());
    for (int i = 0; i < in_row; ++i) {
      const double x = in_row == 1 ? 0 : half * (2.0 * i / (in_row - 1) - 1);
      points.push_back(front_point_mm(spec, x, y).cast<float>());
    }
  }
  return points;
}

}  // namespace finsight::host
