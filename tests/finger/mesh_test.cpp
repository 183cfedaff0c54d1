#include "hostgen/finger/mesh.h"

#include <doctest/doctest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <map>
#include <numbers>
#include <set>
#include <sstream>

#include "firmware/input_error.h"
#include "hostgen/finger/tetgen.h"
#include "hostgen/util/common.h"

using namespace finsight;
using namespace finsight::host;
using Eigen::Vector3d;

namespace {

const FingerSpec& srm() {
  static const FingerSpec spec = read_finger_spec(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml");
  return spec;
}

const TetMesh& srm_mesh() {
  static const TetMesh mesh = make_mesh(srm());
  return mesh;
}

Vector3d at(const TetMesh& mesh, int node) { return Eigen::Map<const Vector3d>(mesh.node_mm[node].data()); }

double volume_mm3(const TetMesh& mesh, std::size_t tet) {
  Eigen::Matrix3d edges;
  for (int i = 0; i < 3; ++i) edges.col(i) = at(mesh, mesh.tets[tet][i + 1]) - at(mesh, mesh.tets[tet][0]);
  return edges.determinant() / 6;
}

/// Smallest angle between two faces, measured at each edge in the plane across it.
double smallest_dihedral_deg(const TetMesh& mesh) {
  double smallest = 180;
  for (const auto& tet : mesh.tets) {
    for (int a = 0; a < 4; ++a) {
      for (int b = a + 1; b < 4; ++b) {
        int others[2], n = 0;
        for (int c = 0; c < 4; ++c) {
          if (c != a && c != b) others[n++] = c;
        }
        const Vector3d edge = (at(mesh, tet[b]) - at(mesh, tet[a])).normalized();
        const auto across = [&](int c) {
          const Vector3d d = at(mesh, tet[c]) - at(mesh, tet[a]);
          return Vector3d(d - edge * edge.dot(d));
        };
        const Vector3d u = across(others[0]), v = across(others[1]);
        smallest = std::min(smallest, std::atan2(u.cross(v).norm(), u.dot(v)) * 180 / std::numbers::pi);
      }
    }
  }
  return smallest;
}

double integral(double low, double high, auto&& area) {  // Simpson, exact for cubics
  return (high - low) / 6 * (area(low) + 4 * area((low + high) / 2) + area(high));
}

/// A private folder; TMPDIR points into it, so that leftovers show.
struct TemporaryFolder {
  std::filesystem::path path;
  TemporaryFolder() {
    std::string name = "/tmp/mesh_test_XXXXXX";
    path = mkdtemp(name.data());
    std::filesystem::create_directory(path / "tmp");
    setenv("TMPDIR", (path / "tmp").c_str(), 1);
  }
  ~TemporaryFolder() {
    unsetenv("TMPDIR");
    std::filesystem::remove_all(path);
  }
  std::string script(const std::string& body) const {
    const auto file = path / "program";
    std::ofstream(file) << "#!/bin/sh\n" << body << "\n";
    std::filesystem::permissions(file, std::filesystem::perms::owner_all);
    return file.string();
  }
  bool no_leftovers() const { return std::filesystem::is_empty(path / "tmp"); }
};

std::string failure(const std::string& program, std::chrono::milliseconds limit,
                    const std::string& poly = "0 3 0 0\n") {
  try {
    run_tetgen(poly, "pQ", limit, program);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("mesh: the paper's finger has 3-4 thousand well-shaped, right-handed tetrahedra") {
  const TetMesh& mesh = srm_mesh();
  CHECK(mesh.tets.size() >= 3000);
  CHECK(mesh.tets.size() <= 4000);
  CHECK(mesh.min_dihedral_deg >= 10);
  CHECK(mesh.min_dihedral_deg == doctest::Approx(smallest_dihedral_deg(mesh)));
  REQUIRE(mesh.region.size() == mesh.tets.size());
  for (std::size_t tet = 0; tet < mesh.tets.size(); ++tet) CHECK(volume_mm3(mesh, tet) > 0);
}

TEST_CASE("mesh: tetrahedra meet face to face and every node is used") {
  const TetMesh& mesh = srm_mesh();
  std::map<std::array<int, 3>, int> faces;
  std::vector<bool> used(mesh.node_mm.size());
  for (const auto& tet : mesh.tets) {
    for (int left_out = 0; left_out < 4; ++left_out) {
      std::array<int, 3> face;
      std::copy_if(tet.begin(), tet.end(), face.begin(), [&](int node) { return node != tet[left_out]; });
      std::sort(face.begin(), face.end());
      ++faces[face];
      used[tet[left_out]] = true;
    }
  }
  CHECK(std::count(used.begin(), used.end(), false) == 0);
  std::map<std::array<int, 2>, int> border_edges;
  for (const auto& [face, owners] : faces) {
    CHECK(owners <= 2);
    if (owners == 2) continue;
    for (const auto& edge : {std::array{face[0], face[1]}, {face[0], face[2]}, {face[1], face[2]}})
      ++border_edges[edge];
  }
  for (const auto& [edge, count] : border_edges) CHECK(count % 2 == 0);  // the surface has no rim
}

TEST_CASE("mesh: body and plates have the volumes that follow from the spec") {
  const FingerSpec& s = srm();
  const auto inner_half = [&](double y) { return s.half_width.at(y) - s.side_wall_mm; };
  const auto depth = [&](double y) { return s.back_z.at(y) - s.front_z.at(y); };
  const auto inner_depth = [&](double y) { return depth(y) - s.front_wall_mm - s.back_wall_mm; };
  double expected[1 + kPlates] = {};
  // Front wall and back posts over the whole height; where a ring is, its sides and the back between the posts; the
  // cap.
  expected[0] = integral(0, s.height_mm, [&](double y) {
    return s.front_wall_mm * 2 * s.half_width.at(y) + 2 * s.back_wall_mm * s.side_wall_mm;
  });
  const auto ring = [&](double y) { return 2 * s.side_wall_mm * inner_depth(y) + 2 * inner_half(y) * s.back_wall_mm; };
  expected[0] += integral(0, s.base_ring_mm, ring);
  expected[0] += integral(s.height_mm - s.top_mm, s.height_mm,
                          [&](double y) { return ring(y) + 2 * inner_half(y) * inner_depth(y); });
  for (int i = 0; i < kPlates; ++i) {
    const PlateSpec& p = s.plates[i];
    const double beam = p.beam_y_mm - s.beam_mm / 2;
    const auto width = [&](double y) { return (p.across[1] - p.across[0]) * inner_half(y); };
    const auto plate_area = [&](double y) { return width(y) * (p.deep[1] - p.deep[0]) * inner_depth(y); };
    expected[1 + i] = integral(beam - s.plate_mm, beam, plate_area);
    expected[0] += integral(beam, beam + s.beam_mm, [&](double y) {
      return ring(y) + (i == kTopPlate ? width(y) * inner_depth(y) : plate_area(y));
    });
  }
  double volumes[1 + kPlates] = {};
  for (std::size_t tet = 0; tet < srm_mesh().tets.size(); ++tet) {
    volumes[srm_mesh().region[tet]] += volume_mm3(srm_mesh(), tet);
  }
  for (int region = 0; region <= kPlates; ++region) {
    CHECK(volumes[region] == doctest::Approx(expected[region]).epsilon(1e-9));
  }
}

TEST_CASE("mesh: node sets are the touched face, the base and the plates") {
  const FingerSpec& spec = srm();
  const TetMesh& mesh = srm_mesh();
  const std::set<int> front(mesh.front_nodes.begin(), mesh.front_nodes.end());
  const std::set<int> base(mesh.base_nodes.begin(), mesh.base_nodes.end());
  CHECK(std::is_sorted(mesh.front_nodes.begin(), mesh.front_nodes.end()));
  for (int node = 0; node < static_cast<int>(mesh.node_mm.size()); ++node) {
    const Vector3d x = at(mesh, node);
    CHECK(front.contains(node) == (x.z() - spec.front_z.at(x.y()) < 1e-6));
    CHECK(base.contains(node) == (x.y() < 1e-6));
    CHECK(x.z() - spec.front_z.at(x.y()) > -1e-6);
  }
  for (int plate = 0; plate < kPlates; ++plate) {
    REQUIRE(mesh.plate_nodes[plate].size() >= 8);
    Eigen::AlignedBox3d box;
    for (const int node : mesh.plate_nodes[plate]) box.extend(at(mesh, node));
    const Vector3d marker = spec.plates[plate].T_finger_marker.translation();
    CHECK(box.min().y() == doctest::Approx(marker.y()));
    CHECK(box.max().y() == doctest::Approx(marker.y() + spec.plate_mm));
    for (const int axis : {0, 2}) {
      CHECK(box.min()[axis] <= marker[axis] - spec.marker_size_mm * 2 / 3);
      CHECK(box.max()[axis] >= marker[axis] + spec.marker_size_mm * 2 / 3);
    }
  }
}

TEST_CASE("mesh: the front triangles tile the touched face and point outward") {
  const FingerSpec& spec = srm();
  double area = 0;
  const Vector3d inward = Vector3d(0, -spec.front_z.slope, 1).normalized();
  for (const auto& [a, b, c] : front_triangles(srm_mesh())) {
    const Vector3d twice = (at(srm_mesh(), b) - at(srm_mesh(), a)).cross(at(srm_mesh(), c) - at(srm_mesh(), a));
    CHECK(twice.normalized().dot(inward) == doctest::Approx(-1));
    area += twice.norm() / 2;
  }
  CHECK(area == doctest::Approx((60 + 34) / 2.0 * std::hypot(120, 28.39 - 1.714)));
}

TEST_CASE("mesh: the same spec gives the same bytes") {
  const TetMesh again = make_mesh(srm());
  CHECK(again.node_mm == srm_mesh().node_mm);
  CHECK(again.tets == srm_mesh().tets);
  CHECK(again.region == srm_mesh().region);
}

TEST_CASE("mesh: coarse and fine meshes") {
  const TetMesh coarse = make_mesh(srm(), MeshSize::kCoarse);
  CHECK(coarse.tets.size() < srm_mesh().tets.size());
  CHECK(coarse.min_dihedral_deg > 5);
  const TetMesh fine = make_mesh(srm(), MeshSize::kFine);
  CHECK(fine.tets.size() > 14000);
  CHECK(fine.tets.size() < 16500);
  CHECK(fine.min_dihedral_deg >= 14.9);
}

TEST_CASE("mesh: a finger whose parts do not fit is refused before TetGen sees it") {
  FingerSpec spec = srm();
  spec.back_wall_mm = 9;
  CHECK_THROWS_AS(make_mesh(spec), InputError);
  spec = srm();
  spec.plates[kMiddlePlate].beam_y_mm = spec.plates[kTopPlate].beam_y_mm;
  CHECK_THROWS_AS(make_mesh(spec), InputError);
}

TEST_CASE("mesh: a TetGen that is missing, fails, hangs or lies is an error, and nothing is left behind") {
  const TemporaryFolder folder;
  using namespace std::chrono_literals;
  CHECK(failure("no-such-tetgen", 1000ms).find("apt-get install tetgen") != std::string::npos);
  CHECK(failure(folder.script("exec sleep 60"), 30ms).find("was stopped") != std::string::npos);
  CHECK(failure(folder.script("while :; do :; done"), 30ms).find("ms of processor time") != std::string::npos);
  // Waiting for others is no reason to be stopped: half a second, of which next to nothing is processor time.
  CHECK(failure(folder.script("sleep 0.5"), 200ms).find("wrote no mesh") != std::string::npos);
  CHECK(failure(folder.script("echo bad facet; exit 3"), 10s).find("exit code 3:\nbad facet") != std::string::npos);
  CHECK(failure(folder.script("kill -ABRT $$"), 10s).find("signal 6") != std::string::npos);
  CHECK(failure(folder.script("exit 0"), 10s).find("no mesh") != std::string::npos);
  const std::string write = "d=$(dirname \"$2\"); ";
  const std::string nodes = "printf '4 3 0 0\\n0 0 0 0\\n1 1 0 0\\n2 0 1 0\\n3 0 0 1\\n' > $d/finger.1.node; ";
  CHECK(failure(folder.script(write + nodes + "echo '1 4 1 0 0 1 2 7 0' > $d/finger.1.ele"), 10s).find("range") !=
        std::string::npos);
  CHECK(failure(folder.script(write + nodes + "echo '2 4 1 0 0 1 2 3 0' > $d/finger.1.ele"), 10s).find("early") !=
        std::string::npos);
  CHECK(failure(folder.script(write + nodes + "echo '1 4 1 0 0 1 2 3 0' > $d/finger.1.ele"), 10s) == "");
  CHECK(failure("tetgen", 10s, "nonsense\n") != "");
  CHECK(folder.no_leftovers());
}

TEST_CASE("mesh: touch points are exactly as many as asked for and lie on the touched part of the face") {
  const FingerSpec& spec = srm();
  for (const int count : {1, 2, 3, 5, 17, 60, 200, 567}) {
    const auto points = touch_points(spec, count);
    REQUIRE(static_cast<int>(points.size()) == count);
    for (const Vec3f& p : points) {
      CHECK(p.y() >= 13 - 1e-4);
      CHECK(p.y() <= 107 + 1e-4);
      CHECK(std::abs(p.x()) <= spec.half_width.at(p.y()) - spec.touch_edge_mm + 1e-4);
      CHECK(p.z() == doctest::Approx(spec.front_z.at(p.y())));
    }
  }
  CHECK_THROWS_AS(touch_points(spec, 0), std::invalid_argument);
}

TEST_CASE("mesh: touch points cover the face evenly") {
  for (const int count : {30, 60, 300}) {
    const auto points = touch_points(srm(), count);
    const double area_each = 94.0 * 2 * 21.2 / count;
    double nearest_pair = 1e9, largest_hole = 0;
    for (std::size_t i = 0; i < points.size(); ++i) {
      for (std::size_t j = 0; j < i; ++j) nearest_pair = std::min<double>(nearest_pair, (points[i] - points[j]).norm());
    }
    for (double y = 13; y <= 107; y += 2) {
      const double half = srm().half_width.at(y) - srm().touch_edge_mm;
      for (double x = -half; x <= half; x += half / 10) {
        double nearest = 1e9;
        for (const Vec3f& p : points) nearest = std::min<double>(nearest, std::hypot(p.x() - x, p.y() - y));
        largest_hole = std::max(largest_hole, nearest);
      }
    }
    CHECK(nearest_pair > 0.7 * std::sqrt(area_each));
    CHECK(largest_hole < 1.1 * std::sqrt(area_each));
  }
}

namespace {

/// As much XML as a .vtu needs: every element must be closed, and every DataArray's numbers are kept by name.
std::map<std::string, std::vector<double>> read_vtu(const std::string& text,
                                                    std::map<std::string, std::string>& headers) {
  std::map<std::string, std::vector<double>> arrays;
  std::vector<std::string> open;
  std::string array;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t begin = text.find('<', at);
    if (begin == std::string::npos) break;
    const std::size_t end = text.find('>', begin);
    REQUIRE(end != std::string::npos);
    if (!array.empty()) {
      std::istringstream numbers(text.substr(at, begin - at));
      for (double value; numbers >> value;) arrays[array].push_back(value);
      CHECK(numbers.eof());
      array.clear();
    }
    const std::string tag = text.substr(begin + 1, end - begin - 1);
    const std::string name = tag.substr(0, tag.find(' '));
    at = end + 1;
    if (tag[0] == '?') continue;
    if (tag[0] == '/') {
      REQUIRE(!open.empty());
      CHECK(open.back() == tag.substr(1));
      open.pop_back();
      continue;
    }
    const std::string parent = open.empty() ? "" : open.back();
    open.push_back(name);
    headers[name] = tag;
    if (name != "DataArray") continue;
    const std::size_t quote = tag.find("Name=\"") + 6;
    array = parent + "/" + tag.substr(quote, tag.find('"', quote) - quote);
    headers[array] = tag;
  }
  CHECK(open.empty());
  return arrays;
}

}  // namespace

TEST_CASE("vtu: what is read back is the mesh with its labels") {
  const TemporaryFolder folder;
  const TetMesh& mesh = srm_mesh();
  std::vector<double> displacement(3 * mesh.node_mm.size());
  for (std::size_t i = 0; i < displacement.size(); ++i) displacement[i] = std::sin(static_cast<double>(i));
  const auto file = folder.path / "finger.vtu";
  write_vtu(file, mesh, &displacement);
  std::map<std::string, std::string> headers;
  auto arrays = read_vtu(read_file(file), headers);

  CHECK(headers["VTKFile"].find("type=\"UnstructuredGrid\"") != std::string::npos);
  CHECK(headers["Piece"] == "Piece NumberOfPoints=\"" + std::to_string(mesh.node_mm.size()) + "\" NumberOfCells=\"" +
                                std::to_string(mesh.tets.size()) + "\"");
  CHECK(headers["Points/position_mm"].find("NumberOfComponents=\"3\"") != std::string::npos);
  CHECK(headers["PointData/displacement_mm"].find("NumberOfComponents=\"3\"") != std::string::npos);
  CHECK(arrays["PointData/displacement_mm"] == displacement);
  const auto& position = arrays["Points/position_mm"];
  REQUIRE(position.size() == 3 * mesh.node_mm.size());
  for (std::size_t i = 0; i < position.size(); ++i) CHECK(position[i] == mesh.node_mm[i / 3][i % 3]);
  const auto& connectivity = arrays["Cells/connectivity"];
  REQUIRE(connectivity.size() == 4 * mesh.tets.size());
  for (std::size_t i = 0; i < connectivity.size(); ++i) CHECK(connectivity[i] == mesh.tets[i / 4][i % 4]);
  CHECK(arrays["Cells/types"] == std::vector<double>(mesh.tets.size(), 10));
  CHECK(arrays["Cells/offsets"].back() == static_cast<double>(4 * mesh.tets.size()));
  CHECK(arrays["CellData/region"] == std::vector<double>(mesh.region.begin(), mesh.region.end()));
  const auto labelled = [&](const std::string& array, double value) {
    std::vector<int> nodes;
    for (std::size_t i = 0; i < arrays[array].size(); ++i) {
      if (arrays[array][i] == value) nodes.push_back(static_cast<int>(i));
    }
    return nodes;
  };
  CHECK(labelled("PointData/front", 1) == mesh.front_nodes);
  CHECK(labelled("PointData/base", 1) == mesh.base_nodes);
  for (int plate = 0; plate < kPlates; ++plate) {
    CHECK(labelled("PointData/plate", 1 + plate) == mesh.plate_nodes[plate]);
  }
}

TEST_CASE("vtu: without displacement there is no such array, and a wrong length is refused") {
  const TemporaryFolder folder;
  write_vtu(folder.path / "finger.vtu", srm_mesh());
  CHECK(read_file(folder.path / "finger.vtu").find("displacement") == std::string::npos);
  const std::vector<double> too_short(3);
  CHECK_THROWS_AS(write_vtu(folder.path / "bad.vtu", srm_mesh(), &too_short), std::invalid_argument);
}

TEST_CASE("vtu: an arrow is a line that ends where its force acts and moves with the face") {
  const TemporaryFolder folder;
  const TetMesh& mesh = srm_mesh();
  const std::vector<double> displacement(3 * mesh.node_mm.size());
  const ForceArrow arrow{{1, 60, -15}, {0, 0, 7}, {0, -0.5, 2}};
  write_vtu(folder.path / "force.vtu", mesh, &displacement, {arrow});
  std::map<std::string, std::string> headers;
  auto arrays = read_vtu(read_file(folder.path / "force.vtu"), headers);
  const auto last_two = [&](const std::string& array) {
    const auto& values = arrays[array];
    return std::vector<double>(values.end() - 6, values.end());
  };
  CHECK(last_two("Points/position_mm") == std::vector<double>{1, 62.5, -25, 1, 60, -15});
  CHECK(last_two("PointData/displacement_mm") == std::vector<double>{0, 0, 7, 0, 0, 7});
  CHECK(last_two("PointData/force_n") == std::vector<double>{0, 0, 0, 0, -0.5, 2});
  CHECK(arrays["Cells/types"].back() == 3);
  CHECK(arrays["CellData/region"].back() == -1);
  CHECK(arrays["Cells/offsets"].back() == static_cast<double>(4 * mesh.tets.size() + 2));
  CHECK(arrays["Cells/connectivity"].back() == static_cast<double>(mesh.node_mm.size() + 1));
  CHECK(arrays["PointData/front"].size() == mesh.node_mm.size() + 2);
}
