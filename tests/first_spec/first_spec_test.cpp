#include "hostgen/first_spec/first_spec.h"

#include <doctest/doctest.h>

#include "firmware/input_error.h"
#include "hostgen/finger/plate_geometry.h"
#include "hostgen/first_spec/camera_picture.h"
#include "hostgen/util/common.h"
#include "tests/finger/surfaces.h"
#include "tests/model/scratch_folder.h"

using namespace finsight;
using namespace finsight::host;
using Eigen::Vector3d;

namespace {

const std::filesystem::path kFingers = FINSIGHT_SOURCE_DIR "/hostgen/fingers";

/// bowed.obj as somebody else would draw it: in metres, lying along x, its front upwards.
TriangleSurface lying_in_metres() {
  TriangleSurface surface = read_triangles(kFingers / "bowed.obj", 1);
  for (Vector3d& at : surface.point_mm) at = 0.001 * (Vector3d(at.y(), at.x(), -at.z()) + Vector3d(300, -20, 55));
  return surface;
}

}  // namespace

TEST_CASE("first spec: a finger that lies anywhere gets a spec that is read, with its own plates") {
  const test::ScratchFolder folder;
  test::write_obj(folder / "drawn.obj", lying_in_metres());
  const FirstSpec first = propose_spec(folder / "drawn.obj", folder / "drawn.toml");
  CAPTURE(first.toml);
  REQUIRE(first.plates.size() == 3);
  const FingerSpec spec = read_finger_spec(folder.write("drawn.toml", first.toml));
  const FingerSpec by_hand = read_finger_spec(kFingers / "bowed.toml");
  CHECK(spec.height_mm == doctest::Approx(by_hand.height_mm).epsilon(0.001));
  for (std::size_t p = 0; p < kPlates; ++p) {
    const Vector3d found = spec.plates[p].T_finger_marker.translation();
    const Vector3d wanted = by_hand.plates[p].T_finger_marker.translation();
    CHECK(found.y() == doctest::Approx(wanted.y()).epsilon(0.001));
    CHECK(std::abs(found.x()) == doctest::Approx(std::abs(wanted.x())).epsilon(0.1));
  }
  CHECK(spec.touch_y_mm[0] < 20);
  CHECK(spec.touch_y_mm[1] > 80);
  CHECK(spec.half_width.at(50) > 12);
  CHECK(spec.surface->source.units == "m");
}

TEST_CASE("first spec: the picture shows markers where the camera sees them, and walls in front of those it does not") {
  const test::ScratchFolder folder;
  test::write_obj(folder / "drawn.obj", lying_in_metres());
  const FirstSpec first = propose_spec(folder / "drawn.obj", folder / "drawn.toml");
  const FingerSpec spec = read_finger_spec(folder.write("drawn.toml", first.toml));
  std::vector<PicturedMarker> markers;
  for (std::size_t p = 0; p < kPlates; ++p) {
    markers.push_back({spec.plates[p].T_finger_marker, spec.plates[p].marker_id, spec.marker_size_mm});
  }
  const Lens& lens = spec.cameras[1];
  const auto level = [&](const std::vector<std::uint8_t>& grey, const Vector3d& at) {
    const Vector3d seen = spec.T_finger_camera.inverse() * at;
    const Eigen::Vector2d pixel = pixel_from_ray(lens, Eigen::Vector2d(seen.head<2>() / seen.z()));
    return grey[static_cast<std::size_t>(std::lround(pixel.y())) * 640 +
                static_cast<std::size_t>(std::lround(pixel.x()))];
  };
  const auto grey = camera_picture(spec.surface->surface, markers, spec.T_finger_camera, lens);
  TriangleSurface walled = spec.surface->surface;
  const int corner = static_cast<int>(walled.point_mm.size());
  walled.point_mm.insert(walled.point_mm.end(), {{-50, 5, -50}, {50, 5, -50}, {0, 5, 80}});
  walled.triangle.push_back({corner, corner + 1, corner + 2});
  const auto hidden = camera_picture(walled, markers, spec.T_finger_camera, lens);
  for (const PicturedMarker& marker : markers) {
    const double half = marker.size_mm / 2;
    const Vector3d paper = marker.T_finger_marker * Vector3d(half * 7 / 6, 0, 0);
    const Vector3d frame = marker.T_finger_marker * Vector3d(half * 5 / 6, 0, 0);  // the black border
    CHECK(level(grey, paper) > 200);
    CHECK(level(grey, frame) < 40);
    CHECK(level(hidden, paper) < 200);
  }
}

TEST_CASE("first spec: what is missing is said, and a surface that bounds no solid is refused") {
  const test::ScratchFolder folder;
  test::write_binary_stl(folder / "brick.stl", test::box_surface({0, 0, 0}, {40, 100, 30}));
  const FirstSpec brick = propose_spec(folder / "brick.stl", folder / "brick.toml");
  CHECK(brick.plates.empty());
  CHECK(brick.toml.find("# NOTE: 0 plates found, three are needed") != std::string::npos);
  CHECK_THROWS_AS(read_finger_spec(folder.write("brick.toml", brick.toml)), InputError);
  TriangleSurface open = test::box_surface({0, 0, 0}, {40, 100, 30});
  open.triangle.pop_back();
  test::write_binary_stl(folder / "open.stl", open);
  CHECK_THROWS_WITH_AS(propose_spec(folder / "open.stl", folder / "open.toml"), doctest::Contains("open edges"),
                       InputError);
}

TEST_CASE("first spec: units that would also do are named, and the more usual finger is taken") {
  const test::ScratchFolder folder;
  const auto units = [&](double scale) {
    test::write_binary_stl(folder / "brick.stl", test::box_surface({0, 0, 0}, Vector3d(40, 100, 30) * scale));
    const FirstSpec first = propose_spec(folder / "brick.stl", folder / "brick.toml");
    return first.finger.source.units + (first.toml.find("check surface.units") == std::string::npos ? "" : "?");
  };
  CHECK(units(1) == "mm");
  CHECK(units(0.001) == "m");
  CHECK(units(0.1) == "cm?");
  CHECK(units(0.04) == "inch?");
}

TEST_CASE("first spec: names that TOML would misread are escaped") {
  const test::ScratchFolder folder;
  const std::string name = "a\"b\\c\nd";
  test::write_obj(folder / (name + ".obj"), lying_in_metres());
  const FirstSpec first = propose_spec(folder / (name + ".obj"), folder / "spec.toml");
  CHECK(read_finger_spec(folder.write("spec.toml", first.toml)).name == name);
}
