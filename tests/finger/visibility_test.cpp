#include <doctest/doctest.h>

#include <Eigen/Dense>

#include "firmware/input_error.h"
#include "hostgen/finger/mesh.h"

using namespace finsight;
using namespace finsight::host;
using Eigen::Vector3d;

namespace {

FingerSpec srm() {
  static const FingerSpec spec = read_finger_spec(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml");
  return spec;
}

/// The reason of the refusal; empty if all markers are seen.
std::string refusal(const FingerSpec& spec) {
  try {
    check_visibility(spec);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

bool names(const std::string& message, const std::string& plate, const std::string& obstacle) {
  return message.find("plates." + plate) != std::string::npos && message.find(obstacle) != std::string::npos;
}

/// Moves a plate across the finger, marker and all.
void shift_plate(FingerSpec& spec, int plate, double across_from, double across_to) {
  PlateSpec& p = spec.plates[plate];
  p.across = {across_from, across_to};
  const double y = p.T_finger_marker.translation().y();
  p.T_finger_marker.translation().x() = (spec.half_width.at(y) - spec.side_wall_mm) * (across_from + across_to) / 2;
}

/// At rest, by brute force against the tetrahedra themselves: how many of the marker's points are hidden from the
/// camera by a tet that is not of the marker's own plate.
int hidden_points(const FingerSpec& spec, const TetMesh& mesh, int plate) {
  const Vector3d camera = spec.T_finger_camera.translation();
  int hidden = 0;
  for (double v = -5.3; v <= 5.3; v += 1.06) {
    for (double u = -5.3; u <= 5.3; u += 1.06) {
      const Vector3d ray = spec.plates[plate].T_finger_marker * Vector3d(u, v, 0) - camera;
      bool hit = false;
      for (std::size_t t = 0; t < mesh.tets.size() && !hit; ++t) {
        if (mesh.region[t] == kFirstPlateRegion + plate) continue;
        Eigen::Matrix4d corners;  // barycentric coordinates along the ray are linear: b(s) = b0 + s b1
        for (int i = 0; i < 4; ++i) {
          const auto& x = mesh.node_mm[mesh.tets[t][i]];
          corners.col(i) << x[0], x[1], x[2], 1;
        }
        const Eigen::Matrix4d inverse = corners.inverse();
        const Eigen::Vector4d b0 = inverse * camera.homogeneous();
        const Eigen::Vector4d b1 = inverse * (Eigen::Vector4d() << ray, 0).finished();
        double first = 0, last = 1 - 1e-9;
        for (int i = 0; i < 4; ++i) {
          if (b1[i] > 0) first = std::max(first, -b0[i] / b1[i]);
          if (b1[i] < 0) last = std::min(last, -b0[i] / b1[i]);
          if (b1[i] == 0 && b0[i] < 0) last = -1;
        }
        hit = first < last;
      }
      hidden += hit;
    }
  }
  return hidden;
}

}  // namespace

TEST_CASE("visibility: the paper's finger shows all markers, also by brute force against its tetrahedra") {
  const FingerSpec spec = srm();
  CHECK(refusal(spec) == "");
  const TetMesh mesh = make_mesh(spec, MeshSize::kCoarse);
  for (int plate = 0; plate < kPlates; ++plate) CHECK(hidden_points(spec, mesh, plate) == 0);
}

TEST_CASE("visibility: a plate in front of another is refused, as brute force finds too") {
  FingerSpec spec = srm();
  shift_plate(spec, kMiddlePlate, -0.3, 0.3);
  CHECK_MESSAGE(names(refusal(spec), "top", "hidden by the middle"), refusal(spec));
  CHECK(hidden_points(spec, make_mesh(spec, MeshSize::kCoarse), kTopPlate) > 10);

  spec = srm();
  shift_plate(spec, kLowPlate, 0.5, 1.0);
  spec.plates[kLowPlate].beam_y_mm += 10;
  spec.plates[kLowPlate].T_finger_marker.translation().y() += 10;
  CHECK_MESSAGE(names(refusal(spec), "middle", "hidden by the low"), refusal(spec));
}

TEST_CASE("visibility: a camera that looks through a wall is refused") {
  FingerSpec spec = srm();
  spec.T_finger_camera.translation().z() = -45;  // in front of the touched face
  CHECK_MESSAGE(refusal(spec).find("hidden by the ") != std::string::npos, refusal(spec));
}

TEST_CASE("visibility: a marker at the image's edge is refused for the image that cuts it") {
  FingerSpec spec = srm();
  spec.cameras[1].cx = 60;
  CHECK_MESSAGE(names(refusal(spec), "low", "outside the image of 640x480"), refusal(spec));
  spec = srm();
  spec.T_finger_camera.linear().col(1) *= -1;
  spec.T_finger_camera.linear().col(2) *= -1;  // looks down
  CHECK_MESSAGE(names(refusal(spec), "top", "outside the image of 1280x720"), refusal(spec));
  spec = srm();
  spec.T_finger_camera.translation().y() = 200;
  CHECK_MESSAGE(names(refusal(spec), "top", "turned away"), refusal(spec));
}

TEST_CASE("visibility: points where the distortion folds back do not count as seen") {
  FingerSpec spec = srm();
  for (Lens& camera : spec.cameras) camera.k1 = -6;  // folds back at a radius of 0.24
  CHECK_MESSAGE(refusal(spec).find("outside the image") != std::string::npos, refusal(spec));
}

TEST_CASE("visibility: what hides a marker only when the finger is bent is found, with the pose") {
  FingerSpec spec = srm();
  for (PlateSpec& plate : spec.plates) plate.range = {};
  CHECK(refusal(spec) == "");
  spec.plates[kTopPlate].range.sideways_mm = 18;  // half of it already reaches the middle plate
  CHECK_MESSAGE(names(refusal(spec), "top", "hidden by the middle"), refusal(spec));
  CHECK(refusal(spec).find("when moved inward") != std::string::npos);
  spec.plates[kTopPlate].range = {.inward_mm = 0, .sideways_mm = 0, .tilt_rad = 3.0, .turn_rad = 0};
  CHECK_MESSAGE(names(refusal(spec), "top", "turned away"), refusal(spec));
}

TEST_CASE("visibility: a tenth more than the working range is still seen") {
  FingerSpec spec = srm();
  for (PlateSpec& plate : spec.plates) {
    plate.range.inward_mm *= 1.1;
    plate.range.sideways_mm *= 1.1;
    plate.range.tilt_rad *= 1.1;
    plate.range.turn_rad *= 1.1;
  }
  CHECK(refusal(spec) == "");
}
