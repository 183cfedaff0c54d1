#include "hostgen/finger/spec.h"

#include <doctest/doctest.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <set>

#include "firmware/input_error.h"
#include "hostgen/util/common.h"

using namespace finsight;
using namespace finsight::host;

namespace {

const std::filesystem::path kSrm = FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml";

/// Reads a spec that is given as text.
FingerSpec read_text(const std::string& text) {
  const auto file = std::filesystem::temp_directory_path() / ("spec_test_" + std::to_string(getpid()) + ".toml");
  std::ofstream(file) << text;
  struct Remove {
    std::filesystem::path file;
    ~Remove() { std::filesystem::remove(file); }
  } remove{file};
  return read_finger_spec(file);
}

/// The message with which the finger is refused after one replacement in srm.toml; empty if it is accepted.
std::string refusal(const std::string& from, const std::string& to) {
  std::string text = read_file(kSrm);
  const std::size_t place = text.find(from);
  REQUIRE_MESSAGE(place != std::string::npos, from);
  text.replace(place, from.size(), to);
  try {
    read_text(text);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

}  // namespace

TEST_CASE("spec: the paper's finger has the published size and lies where the recordings say") {
  const FingerSpec spec = read_finger_spec(kSrm);
  CHECK(spec.height_mm == doctest::Approx(120));
  CHECK(2 * spec.half_width.at(0) == doctest::Approx(60));
  CHECK(2 * spec.half_width.at(120) == doctest::Approx(34));
  CHECK(spec.back_z.at(60) - spec.front_z.at(60) == doctest::Approx(30).epsilon(0.1));
  for (const double y : {0.0, 50.0, 107.0}) CHECK(spec.front_z.at(y) == doctest::Approx(-28.39 + 0.2223 * y));
  CHECK(spec.half_width.at(13) - spec.touch_edge_mm == doctest::Approx(26).epsilon(0.02));
  CHECK(spec.half_width.at(99) - spec.touch_edge_mm == doctest::Approx(17).epsilon(0.02));
  CHECK(spec.youngs_modulus_mpa == 10);
  CHECK(spec.poisson_ratio == 0.47);
  CHECK(spec.sha256 == sha256_hex(read_file(kSrm)));
}

TEST_CASE("spec: plates are ordered top, middle, low and their markers look down") {
  const FingerSpec spec = read_finger_spec(kSrm);
  std::set<int> ids;
  double last_y = spec.height_mm;
  for (const PlateSpec& plate : spec.plates) {
    const Eigen::Isometry3d& T = plate.T_finger_marker;
    CHECK(T.linear().isApprox((Eigen::Matrix3d() << 1, 0, 0, 0, 0, -1, 0, 1, 0).finished()));
    CHECK(T.linear().determinant() == doctest::Approx(1));
    CHECK(T.translation().y() == doctest::Approx(plate.beam_y_mm - spec.beam_mm / 2 - spec.plate_mm));
    CHECK(T.translation().y() < last_y);
    last_y = T.translation().y();
    ids.insert(plate.marker_id);
  }
  CHECK(ids.size() == kPlates);
  // The low plate hangs on the left side wall: its middle by hand from the numbers in the file.
  const double y = 38 - 3 - 2, inner_half = 30 - 13 * y / 120 - 5;
  CHECK(spec.plates[kLowPlate].T_finger_marker.translation().x() == doctest::Approx(-0.75 * inner_half));
}

TEST_CASE("spec: the camera looks up with its image's right along finger x") {
  const FingerSpec spec = read_finger_spec(kSrm);
  const Eigen::Matrix3d R = spec.T_finger_camera.linear();
  CHECK(R.col(0).isApprox(Eigen::Vector3d(1, 0, 0)));
  CHECK(R.col(1).isApprox(Eigen::Vector3d(0, 0, -1)));
  CHECK(R.col(2).isApprox(Eigen::Vector3d(0, 1, 0)));
  CHECK(spec.T_finger_camera.translation().y() < 0);
}

TEST_CASE("spec: a tilted line of sight still gives a rotation, with camera x nearest to finger x") {
  std::string text = read_file(kSrm);
  const std::string from = "look = [0, 1, 0]";
  text.replace(text.find(from), from.size(), "look = [0.02, 2.0, 0.03]");
  const Eigen::Matrix3d R = read_text(text).T_finger_camera.linear();
  CHECK((R.transpose() * R).isIdentity(1e-12));
  CHECK(R.determinant() == doctest::Approx(1));
  CHECK(R.col(2).isApprox(Eigen::Vector3d(0.02, 2.0, 0.03).normalized()));
  CHECK(R.col(0).x() > 0.99);
}

TEST_CASE("spec: the small image is the scaled centre of the large one") {
  const auto [large, small] = read_finger_spec(kSrm).cameras;
  CHECK(large.width_px == 1280);
  CHECK(small.height_px == 480);
  for (const double x : {-0.4, 0.0, 0.3}) {  // distorted, normalised
    CHECK(small.fx * x + small.cx ==
          doctest::Approx((large.fx * x + large.cx - 160 + 0.5) * 2 / 3 - 0.5).epsilon(1e-5));
    CHECK(small.fy * x + small.cy == doctest::Approx((large.fy * x + large.cy + 0.5) * 2 / 3 - 0.5).epsilon(1e-5));
  }
  CHECK(small.k1 == large.k1);
  CHECK(small.k3 == large.k3);
}

TEST_CASE("spec: numbers that cannot be a finger are refused with the reason") {
  struct Case {
    const char *from, *to, *expected;
  };
  const Case cases[] = {
      {"height_mm = 120", "height_mm = nan", "height_mm"},
      {"height_mm = 120", "height_mm = -120", "height_mm"},
      {"height_mm = 120", "height_mm = inf", "height_mm"},
      {"height_mm = 120", "height_mm = \"tall\"", "a number"},
      {"height_mm = 120", "", "height_mm"},
      {"top_mm = 14", "top_mm = 27", "the cap"},
      {"front_wall_mm = 4", "front_wall_mm = 0", "front_wall_mm"},
      {"front_wall_mm = 4", "front_wall_mm = 40", "walls thinner than the body"},
      {"back_wall_mm = 4", "back_wall_mm = 13", "do not cross"},
      {"side_wall_mm = 5", "side_wall_mm = 29", "side walls thinner than the half width"},
      {"side_wall_mm = 5", "side_wall_mm = -4", "side_wall_mm"},
      {"half_width_mm = [30, 17]", "half_width_mm = [30]", "2 numbers"},
      {"half_width_mm = [30, 17]", "half_width_mm = [30, -17]", "half_width_mm"},
      {"back_z_mm = [24, 9.5]", "back_z_mm = [-30, 9.5]", "the back behind the front"},
      {"back_z_mm = [24, 9.5]", "back_z_mm = [24, -10]", "the back behind the front"},
      {"beam_y_mm = 66", "beam_y_mm = 91", "the top plate"},
      {"beam_y_mm = 38", "beam_y_mm = 8", "the low plate"},
      {"beam_y_mm = 92", "beam_y_mm = 118", "the cap"},
      {"across = [-1, -0.5]", "across = [-1.2, -0.5]", "across"},
      {"across = [-1, -0.5]", "across = [-0.5, -1]", "ascending"},
      {"across = [-1, -0.5]", "across = [-0.99, -0.45]", "an end at the wall"},
      {"across = [-1, -0.5]", "across = [-1, -0.8]", "white border"},
      {"deep = [0.1, 0.9]", "deep = [0.3, 0.7]", "white border"},
      {"deep = [0.1, 0.9]", "deep = [0.1, 1.5]", "deep"},
      {"size_mm = 8 ", "size_mm = 12 ", "white border"},
      {"size_mm = 8 ", "size_mm = 0 ", "size_mm"},
      {"DICT_4X4_50", "DICT_6X6_250", "dictionary"},
      {"marker_id = 1", "marker_id = 0", "a different marker"},
      {"marker_id = 1", "marker_id = 50", "marker_id"},
      {"poisson_ratio = 0.47", "poisson_ratio = 0.5", "poisson_ratio"},
      {"youngs_modulus_mpa = 10", "youngs_modulus_mpa = 0", "youngs_modulus_mpa"},
      {"look = [0, 1, 0]", "look = [1, 0, 0]", "finger x"},
      {"look = [0, 1, 0]", "look = [0, 0, 0]", "no direction"},
      {"look = [0, 1, 0]", "look = [0, 1]", "3 numbers"},
      {"fx = 736.05", "fx = 0", "fx"},
      {"cx = 615.63", "cx = 2000", "cx"},
      {"y_mm = [13, 107]", "y_mm = [107, 13]", "ascending"},
      {"y_mm = [13, 107]", "y_mm = [13, 140]", "y_mm"},
      {"edge_mm = 2.3", "edge_mm = 25", "edge_mm"},
      {"force_n = [1, 6]", "force_n = [-1, 6]", "force_n"},
      {"tilt_deg = 9,", "tilt_deg = 95,", "tilt_deg"},
      {"lateral_mm = 0.010", "lateral_mm = -0.02", "lateral_mm"},
      {"top_mm = 14", "top_mm = 14\ntop_milimetres = 4", "unknown key"},
      {"roll_deg = 0.07", "roll_deg = 0.07, yaw_deg = 1", "unknown key"},
      {"[material]", "[materials]", "material"},
  };
  for (const Case& c : cases) {
    INFO(c.from, " -> ", c.to);
    const std::string message = refusal(c.from, c.to);
    CHECK_MESSAGE(message.find(c.expected) != std::string::npos, message);
  }
}

TEST_CASE("spec: a file cut off anywhere is refused, never read half") {
  const std::string text = read_file(kSrm);
  const std::size_t last_key = text.rfind("rated_deformation_mm");
  for (std::size_t length = 0; length < last_key; length += 61) {
    CHECK_THROWS_AS(read_text(text.substr(0, length)), InputError);
  }
  CHECK_THROWS_AS(read_finger_spec("/nowhere/finger.toml"), InputError);
}
