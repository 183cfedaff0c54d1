// The paper's finger as a CAD program would export it must be the same finger as the one made of numbers.
#include "hostgen/finger/surface_finger.h"

#include <doctest/doctest.h>

#include <Eigen/LU>
#include <sstream>

#include "firmware/input_error.h"
#include "hostgen/finger/mesh.h"
#include "hostgen/finger/plate_geometry.h"
#include "hostgen/util/common.h"
#include "tests/finger/surfaces.h"
#include "tests/model/scratch_folder.h"

using namespace finsight;
using namespace finsight::host;
using Eigen::Vector3d;

namespace {

const std::filesystem::path kFingers = FINSIGHT_SOURCE_DIR "/hostgen/fingers";

const FingerSpec& srm() {
  static const FingerSpec spec = read_finger_spec(kFingers / "srm.toml");
  return spec;
}
const TetMesh& srm_mesh() {
  static const TetMesh mesh = make_mesh(srm(), MeshSize::kCoarse);
  return mesh;
}

Vector3d node(const TetMesh& mesh, int index) {
  return Eigen::Map<const Vector3d>(mesh.node_mm[static_cast<std::size_t>(index)].data());
}

/// The boundary of the parametric finger's mesh.
const TriangleSurface& srm_surface() {
  static const TriangleSurface surface = [] {
    std::map<std::array<int, 3>, std::vector<std::array<int, 3>>> faces;
    for (const auto& [a, b, c, d] : srm_mesh().tets) {
      for (const auto& face : {std::array{b, c, d}, {a, d, c}, {a, b, d}, {a, c, b}}) {
        std::array<int, 3> key = face;
        std::sort(key.begin(), key.end());
        faces[key].push_back(face);
      }
    }
    TriangleSurface result;
    for (std::size_t i = 0; i < srm_mesh().node_mm.size(); ++i)
      result.point_mm.push_back(node(srm_mesh(), static_cast<int>(i)));
    for (const auto& [key, owners] : faces) {
      if (owners.size() == 1) result.triangle.push_back(owners[0]);
    }
    return result;
  }();
  return surface;
}

std::string vector_text(const Vector3d& v) {
  std::ostringstream text;
  text.precision(12);
  text << "[" << v.x() << ", " << v.y() << ", " << v.z() << "]";
  return text.str();
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t place = text.find(from);
  REQUIRE_MESSAGE(place != std::string::npos, from);
  return text.replace(place, from.size(), to);
}

/// srm.toml with the surface of finger.stl in place of its numbers.
std::string spec_text() {
  std::string text = read_file(kFingers / "srm.toml");
  const std::size_t shape = text.find("[shape]"), material = text.find("[material]");
  text.replace(shape, material - shape,
               "[surface]\nfile = \"finger.stl\"\nunits = \"mm\"\n"
               "base = { min_mm = [-40, -1, -40], max_mm = [40, 0.1, 40] }\n"
               "front = { min_mm = [-40, -1, -40], max_mm = [40, 121, 0] }\n");
  for (int p = 0; p < kPlates; ++p) {
    Eigen::AlignedBox3d box;
    for (const int index : srm_mesh().plate_nodes[p]) box.extend(node(srm_mesh(), index));
    const std::size_t from = text.find("beam_y_mm", text.find(std::string("[plates.") + kPlateNames[p]));
    text.replace(from, text.find("marker_id", from) - from,
                 "box = { min_mm = " + vector_text(box.min() - Vector3d(0.4, 1, 0.4)) +
                     ", max_mm = " + vector_text(box.max() + Vector3d(0.4, 0, 0.4)) +
                     " }\nmarker_mm = " + vector_text(srm().plates[p].T_finger_marker.translation()) + "\n");
  }
  return replaced(text, "edge_mm = 2.3", "half_width_mm = [26, 16]");
}

/// The message with which the finger is refused; empty if it is accepted.
std::string refusal(const std::string& text, const TriangleSurface& surface) {
  const test::ScratchFolder folder;
  test::write_binary_stl(folder / "finger.stl", surface);
  try {
    read_finger_spec(folder.write("finger.toml", text));
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

std::array<double, 1 + kPlates> volumes_mm3(const TetMesh& mesh) {
  std::array<double, 1 + kPlates> volumes{};
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    Eigen::Matrix3d edges;
    for (int i = 0; i < 3; ++i) edges.col(i) = node(mesh, mesh.tets[t][i + 1]) - node(mesh, mesh.tets[t][0]);
    volumes[mesh.region[t]] += edges.determinant() / 6;
  }
  return volumes;
}

}  // namespace

TEST_CASE("surface finger: the paper's finger, exported and read again, has the same plates, base and touched face") {
  const test::ScratchFolder folder;
  test::write_binary_stl(folder / "finger.stl", srm_surface());
  const FingerSpec spec = read_finger_spec(folder.write("finger.toml", spec_text()));
  CHECK(spec.sha256 != sha256_hex(read_file(folder / "finger.toml")));  // the surface counts too
  CHECK(spec.height_mm == doctest::Approx(120));
  const TetMesh mesh = make_mesh(spec, MeshSize::kCoarse);
  const auto found = volumes_mm3(mesh), wanted = volumes_mm3(srm_mesh());
  for (std::size_t region = 0; region < wanted.size(); ++region) {
    CHECK(found[region] == doctest::Approx(wanted[region]).epsilon(1e-6));
  }
  const auto area = [](const TetMesh& m) {
    double sum = 0;
    for (const auto& [a, b, c] : front_triangles(m)) {
      const Vector3d twice = (node(m, b) - node(m, a)).cross(node(m, c) - node(m, a));
      CHECK(twice.z() < 0);
      sum += twice.norm() / 2;
    }
    return sum;
  };
  CHECK(area(mesh) == doctest::Approx(area(srm_mesh())).epsilon(1e-6));
  for (const int index : mesh.front_nodes) {
    CHECK(std::abs(node(mesh, index).z() - srm().front_z.at(node(mesh, index).y())) < 1e-4);
  }
  REQUIRE(mesh.base_nodes.size() >= 8);
  for (const int index : mesh.base_nodes) CHECK(std::abs(node(mesh, index).y()) < 1e-4);
  for (int p = 0; p < kPlates; ++p) {
    CHECK(spec.plates[p].T_finger_marker.isApprox(srm().plates[p].T_finger_marker));
    CHECK((plate_half_size_mm(spec, p) - plate_half_size_mm(srm(), p)).norm() < 0.4);
    CHECK(std::abs(carried_y_mm(spec, p)[0] - carried_y_mm(srm(), p)[0]) < 1e-4);
  }
  for (const Vec3f& point : touch_points(spec, 40)) {
    CHECK(double(point.z()) == doctest::Approx(srm().front_z.at(double(point.y()))).epsilon(1e-5));
  }
}

namespace {

/// The finger's surface as an OBJ with a group for each part.
void write_labelled_obj(const std::filesystem::path& file) {
  const TriangleSurface& surface = srm_surface();
  std::map<std::string, std::string> faces;
  for (const auto& corner : surface.triangle) {
    const auto all_of = [&](const std::vector<int>& nodes) {
      return std::all_of(corner.begin(), corner.end(),
                         [&](int point) { return std::binary_search(nodes.begin(), nodes.end(), point); });
    };
    std::string group = all_of(srm_mesh().front_nodes) ? "skin" : all_of(srm_mesh().base_nodes) ? "foot" : "rest";
    for (int p = 0; p < kPlates; ++p) {
      if (all_of(srm_mesh().plate_nodes[p])) group = std::string("plate_") + kPlateNames[p];
    }
    std::string& text = faces[group] += "f";
    for (const int point : corner) text += " " + std::to_string(point + 1);
    text += "\n";
  }
  std::ofstream out(file);
  out.precision(17);
  for (const Vector3d& at : surface.point_mm) out << "v " << at.x() << " " << at.y() << " " << at.z() << "\n";
  for (const auto& [group, text] : faces) out << "g " << group << "\n" << text;
}

/// The spec with labels in place of boxes.
std::string labelled_text() {
  std::string text = replaced(spec_text(), "finger.stl", "finger.obj");
  text = replaced(text, "base = { min_mm = [-40, -1, -40], max_mm = [40, 0.1, 40] }", "base = { label = \"foot\" }");
  text = replaced(text, "front = { min_mm = [-40, -1, -40], max_mm = [40, 121, 0] }", "front = { label = \"skin\" }");
  for (const char* plate : kPlateNames) {
    const std::size_t from = text.find("box = { min_mm", text.find(std::string("[plates.") + plate));
    text.replace(from, text.find("\n", from) - from, std::string("box = { label = \"plate_") + plate + "\" }");
  }
  return text;
}

}  // namespace

TEST_CASE("surface finger: faces that have names in the file may be called by them in place of boxes") {
  const test::ScratchFolder folder;
  write_labelled_obj(folder / "finger.obj");
  const TetMesh mesh = make_mesh(read_finger_spec(folder.write("finger.toml", labelled_text())), MeshSize::kCoarse);
  const auto found = volumes_mm3(mesh), wanted = volumes_mm3(srm_mesh());
  for (std::size_t region = 0; region < wanted.size(); ++region) {
    CHECK(found[region] == doctest::Approx(wanted[region]).epsilon(1e-6));
  }
  CHECK(mesh.front_nodes.size() >= srm_mesh().front_nodes.size());
  for (const int index : mesh.front_nodes) {
    CHECK(std::abs(node(mesh, index).z() - srm().front_z.at(node(mesh, index).y())) < 1e-4);
  }
  CHECK(mesh.base_nodes.size() >= srm_mesh().base_nodes.size());
  for (const int index : mesh.base_nodes) CHECK(std::abs(node(mesh, index).y()) < 1e-4);

  const std::string wrong = replaced(labelled_text(), "\"plate_low\"", "\"plate_lower\"");
  CHECK_THROWS_WITH_AS(read_finger_spec(folder.write("wrong.toml", wrong)),
                       doctest::Contains("plates.low.box: found label \"plate_lower\", expected a name of faces in"),
                       InputError);
  CHECK_THROWS_WITH_AS(read_finger_spec(folder.path() / "wrong.toml"),
                       doctest::Contains("(foot, plate_low, plate_middle, plate_top, rest, skin)"), InputError);
  CHECK(refusal(replaced(spec_text(), "base = { min_mm = [-40, -1, -40], max_mm = [40, 0.1, 40] }",
                         "base = { label = \"foot\" }"),
                srm_surface())
            .find("it has none: OBJ's groups") != std::string::npos);
}

TEST_CASE("surface finger: wrong units are recognised by the finger's size, and likely ones suggested") {
  TriangleSurface in_metres = srm_surface(), in_inches = srm_surface();
  for (Vector3d& at : in_metres.point_mm) at /= 1000;
  for (Vector3d& at : in_inches.point_mm) at /= 25.4;
  const std::string message = refusal(spec_text(), in_metres);
  CHECK_MESSAGE(message.find("finger.stl: size: found a bounding box of 0.06 x 0.12 x 0.05") != std::string::npos,
                message);
  CHECK_MESSAGE(message.find("are these \"m\" (120 mm)?") != std::string::npos, message);
  CHECK(refusal(spec_text(), in_inches).find("\"inch\" (120 mm)") != std::string::npos);
  CHECK(refusal(replaced(spec_text(), "units = \"mm\"", "units = \"m\""), in_metres) == "");
  CHECK(refusal(replaced(spec_text(), "units = \"mm\"", "units = \"m\""), srm_surface()).find("\"mm\" (120 mm)") !=
        std::string::npos);
  CHECK(refusal(replaced(spec_text(), "units = \"mm\"", "units = \"feet\""), srm_surface()).find("\"inch\"") !=
        std::string::npos);
}

TEST_CASE("surface finger: a file with other axes and another origin is the same finger; a mirrored one is refused") {
  TriangleSurface standing = srm_surface();  // along z, its back towards -y
  for (Vector3d& at : standing.point_mm) at = Vector3d(at.x(), -at.z(), at.y()) + Vector3d(500, -30, 7);
  const auto with_axes = [](const std::string& axes) {
    return replaced(spec_text(), "units =", "axes = " + axes + "\norigin_mm = [500, -30, 7]\nunits =");
  };
  CHECK(refusal(with_axes(R"(["x", "z", "-y"])"), standing) == "");
  CHECK(refusal(spec_text(), standing) != "");
  for (const char* axes : {R"(["x", "z", "y"])", R"(["x", "x", "z"])", R"(["x", "z"])", R"(["x", "z", "-w"])",
                           R"(["x", "z", "--y"])", R"(["", "z", "-y"])"}) {
    const std::string message = refusal(with_axes(axes), standing);
    CHECK_MESSAGE(message.find("surface.axes: found axes that do not make a right-handed frame") != std::string::npos,
                  message);
  }
}

TEST_CASE("surface finger: a surface of far too many triangles is refused before work begins") {
  TriangleSurface many = srm_surface();
  while (many.triangle.size() <= 20'000) many.triangle.push_back({0, 1, 2});
  CHECK(refusal(spec_text(), many).find("20001 triangles, expected at most 20000") != std::string::npos);
}

TEST_CASE("surface finger: a surface that bounds no solid is refused by its own file's name") {
  TriangleSurface hole = srm_surface();
  hole.triangle.pop_back();
  const std::string message = refusal(spec_text(), hole);
  CHECK_MESSAGE(message.find("finger.stl: surface: found 3 open edges") != std::string::npos, message);
}

TEST_CASE("surface finger: boxes, markers and touches that are not where the finger is are refused by field") {
  const std::string good = spec_text();
  const std::string plate = good.substr(good.find("box = "), good.find("marker_id") - good.find("box = "));
  const std::string marker = plate.substr(plate.find("marker_mm"));
  struct Case {
    std::string from, to, expected;
  };
  const Case cases[] = {
      {"file = \"finger.stl\"", "file = \"other.stl\"", "other.stl: cannot be opened"},
      {"max_mm = [40, 0.1, 40]", "max_mm = [40, -0.5, 40]", "surface.base: found 0 points"},
      {"max_mm = [40, 0.1, 40]", "max_mm = [40, -2, 40]", "more than min_mm"},
      {"max_mm = [40, 0.1, 40]", "max_mm = [40, 100, 40]", "plates.top.box: found the base in it"},
      {"max_mm = [40, 121, 0]", "max_mm = [40, 121, -28.5]", "surface.front: found no triangle"},
      {plate, "box = { min_mm = [-5, 20, -5], max_mm = [5, 25, 5] }\n" + marker, "plates.top.box"},
      {marker, "marker_mm = [0, 86, 0]\n", "plates.top.marker_mm"},
      {marker, "", "marker_mm"},
      {plate, "joined = \"up\"\n" + plate, "joined"},
      {"half_width_mm = [26, 16]", "half_width_mm = [29, 16]", "beside the touched face"},
      {"half_width_mm = [26, 16]", "edge_mm = 2.3", "half_width_mm"},
      {"y_mm = [13, 107]", "y_mm = [-3, 107]", "beside the touched face"},
      {"position_mm = [0, -22, -3]", "position_mm = [0, -22, -60]", "hidden by the finger around"},
      {"[surface]", "[shape]\nheight_mm = 3\n[surface]", "unknown key"},
  };
  CHECK(refusal(good, srm_surface()) == "");
  for (const Case& c : cases) {
    INFO(c.from, " -> ", c.to);
    const std::string message = refusal(replaced(good, c.from, c.to), srm_surface());
    CHECK_MESSAGE(message.find(c.expected) != std::string::npos, message);
  }
}

TEST_CASE("surface finger: the touched face ends where its box does, also in the middle of triangles") {
  // The wall of one finger is two triangles from base to tip: no corner of them lies between 30 and 80 mm.
  const std::string text = replaced(replaced(spec_text(), "min_mm = [-40, -1, -40], max_mm = [40, 121, 0]",
                                             "min_mm = [-12, 30, -40], max_mm = [40, 80, 0]"),
                                    "y_mm = [13, 107]", "y_mm = [31, 79]");
  const std::string narrow = replaced(text, "half_width_mm = [26, 16]", "half_width_mm = [11, 11]");
  CHECK(refusal(narrow, srm_surface()) == "");
  const test::ScratchFolder folder;
  test::write_binary_stl(folder / "finger.stl", srm_surface());
  const TetMesh mesh = make_mesh(read_finger_spec(folder.write("finger.toml", narrow)), MeshSize::kCoarse);
  Eigen::AlignedBox3d bounds;
  for (const int index : mesh.front_nodes) bounds.extend(node(mesh, index));
  CHECK(bounds.min().y() == doctest::Approx(30));
  CHECK(bounds.max().y() == doctest::Approx(80));
  CHECK(bounds.min().x() == doctest::Approx(-12));
  CHECK(bounds.max().x() > 20);
  CHECK(volumes_mm3(mesh)[0] == doctest::Approx(volumes_mm3(srm_mesh())[0]).epsilon(1e-6));
  CHECK(refusal(text, srm_surface()).find("beside the touched face") != std::string::npos);
  CHECK(refusal(replaced(spec_text(), "max_mm = [40, 121, 0]", "max_mm = [40, 121, -28.5]"), srm_surface())
            .find("the largest that does is triangle ") != std::string::npos);
}

TEST_CASE("surface finger: a refused one can still be shown, with its boxes") {
  const test::ScratchFolder folder;
  test::write_binary_stl(folder / "finger.stl", srm_surface());
  const auto spec =
      folder.write("finger.toml", replaced(spec_text(), "half_width_mm = [26, 16]", "half_width_mm = [29, 16]"));
  CHECK_THROWS_AS(read_finger_spec(spec), InputError);
  const auto finger = read_surface_unchecked(spec);
  REQUIRE(finger);
  CHECK(finger->surface.triangle.size() == srm_surface().triangle.size());
  write_surface_vtu(folder / "finger.vtu", *finger);
  const std::string vtu = read_file(folder / "finger.vtu");
  CHECK(vtu.find("NumberOfCells=\"" + std::to_string(srm_surface().triangle.size() + 5 * 12) + "\"") !=
        std::string::npos);
  CHECK(vtu.find("corners_in_front") != std::string::npos);
  CHECK_FALSE(read_surface_unchecked(kFingers / "srm.toml"));
}

TEST_CASE("surface finger: slivers of CAD are taken out where the spec allows the surface to move") {
  // Pairs of points a few micrometres apart, as fillets and Boolean operations leave them: every edge of the front wall
  // is split next to both of its ends.
  TriangleSurface slivers = srm_surface();
  std::map<std::pair<int, int>, int> added;
  const auto near_end = [&](int end, int other) {
    const auto [place, is_new] = added.try_emplace({end, other}, static_cast<int>(slivers.point_mm.size()));
    const Vector3d along =
        slivers.point_mm[static_cast<std::size_t>(other)] - slivers.point_mm[static_cast<std::size_t>(end)];
    if (is_new) slivers.point_mm.push_back(slivers.point_mm[static_cast<std::size_t>(end)] + 0.02 * along.normalized());
    return place->second;
  };
  std::vector<std::array<int, 3>> triangles;
  for (const auto& [a, b, c] : srm_surface().triangle) {  // a corner cut off at each corner, and what is left of it
    const int ab = near_end(a, b), ba = near_end(b, a), bc = near_end(b, c), cb = near_end(c, b), ca = near_end(c, a),
              ac = near_end(a, c);
    for (const auto& part :
         {std::array{a, ab, ac}, {b, bc, ba}, {c, ca, cb}, {ab, ba, bc}, {ab, bc, cb}, {ab, cb, ca}, {ab, ca, ac}})
      triangles.push_back(part);
  }
  slivers.triangle = triangles;
  TriangleSurface simpler = slivers;
  simplify(simpler, 0.03);
  CHECK_NOTHROW(check_bounds_a_solid(simpler, "simpler"));
  CHECK(simpler.triangle.size() < srm_surface().triangle.size());
  CHECK(test::volume_mm3(simpler) == doctest::Approx(test::volume_mm3(srm_surface())).epsilon(1e-3));
  for (const Vector3d& at : srm_surface().point_mm) {
    double nearest = 1e9;
    for (std::size_t t = 0; t < simpler.triangle.size(); ++t) {
      const auto corner = simpler.corners(t);
      const Vector3d normal = simpler.twice_area(t).normalized();
      const double off = std::abs(normal.dot(at - corner[0]));
      if (off < 0.05) nearest = std::min(nearest, off);
    }
    CHECK(nearest <= 0.03 + 1e-9);
  }
  const test::ScratchFolder folder;
  test::write_obj(folder / "finger.obj", slivers);
  const std::string text = replaced(spec_text(), "finger.stl", "finger.obj");
  const TetMesh bad = make_mesh(read_finger_spec(folder.write("bad.toml", text)), MeshSize::kCoarse);
  const TetMesh good =
      make_mesh(read_finger_spec(folder.write("good.toml", replaced(text, "units =", "simplify_mm = 0.03\nunits ="))),
                MeshSize::kCoarse);
  CHECK(good.tets.size() < 0.5 * static_cast<double>(bad.tets.size()));
  CHECK(good.min_dihedral_deg > bad.min_dihedral_deg);
  CHECK(mesh_advice(bad).find("surface.simplify_mm") != std::string::npos);
}

TEST_CASE("surface finger: a sealed hollow stays empty") {
  const test::ScratchFolder folder;
  const TriangleSurface hollow =
      test::both(srm_surface(), test::turned_inside_out(test::box_surface({-6, 108, 0}, {6, 115, 5})));
  test::write_binary_stl(folder / "finger.stl", hollow);
  const TetMesh mesh = make_mesh(read_finger_spec(folder.write("finger.toml", spec_text())), MeshSize::kCoarse);
  CHECK(volumes_mm3(mesh)[0] == doctest::Approx(volumes_mm3(srm_mesh())[0] - 12 * 7 * 5).epsilon(1e-6));
}

TEST_CASE("surface finger: the example is a finger") {
  const FingerSpec spec = read_finger_spec(kFingers / "bowed.toml");
  const TetMesh mesh = make_mesh(spec);
  CHECK(mesh.min_dihedral_deg > 5);
  for (const Vec3f& point : touch_points(spec, 60)) {
    CHECK(front_point_mm(spec, double(point.x()), double(point.y())).cast<float>().isApprox(point));
  }
}
