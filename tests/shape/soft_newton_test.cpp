#include "firmware/shape/soft_newton.h"

#include <doctest/doctest.h>

#include <limits>

#include "firmware/input_error.h"
#include "firmware/shape/newton.h"
#include "hostgen/fem/shape_model.h"
#include "hostgen/hard_cases/shape_distance.h"
#include "tests/count_allocations.h"
#include "tests/shape/finger_motion.h"
#include "tests/shape/frame_mesh.h"

using namespace finsight;
using host::shape_distance;
using test::Bend;

namespace {

struct Finger {
  host::TetMesh mesh = test::frame_mesh(4, 12, 5);
  host::ShapeModelData exact = host::make_shape_model(mesh), soft = host::make_soft_shape_model(exact.view());
  MountModel mount = test::mount_of(mesh);
};

const Finger& finger() {
  static const Finger the_finger;
  return the_finger;
}

}  // namespace

TEST_CASE("soft newton: with the published stiffness it finds the shape that exact handles give") {
  const Finger& f = finger();
  SoftNewtonSolver<double> soft(f.soft.view(), f.mount);
  NewtonSolver<double> exact(f.exact.view(), f.mount);
  const Bend bend{20, 5, 30};
  for (int frame = 0; frame <= bend.frames(); frame += 4) {
    const PlatePoses poses = bend.frame(f.mount, frame);
    REQUIRE(exact.converge(poses, 1e-8, 100).ok);
    const auto outcome = soft.converge(poses);
    REQUIRE(outcome.ok);
    CHECK(outcome.steps < 20);
    CHECK(shape_distance(soft.node_mm(), exact.node_mm()).worst_mm < 0.05);
  }
  REQUIRE(soft.converge(bend.poses(f.mount), 1e-12).ok);
  CHECK(shape_distance(soft.node_mm(), exact.node_mm()).worst_mm < 0.01);
}

TEST_CASE("soft newton: a jump that would invert elements converges, too, and impossible poses end") {
  const Finger& f = finger();
  SoftNewtonSolver<double> soft(f.soft.view(), f.mount);
  NewtonSolver<double> exact(f.exact.view(), f.mount);
  const PlatePoses far = Bend{30, 0, 45}.poses(f.mount);
  REQUIRE(soft.converge(far).ok);
  REQUIRE(exact.converge(far, 1e-8, 100).ok);
  CHECK(shape_distance(soft.node_mm(), exact.node_mm()).worst_mm < 0.05);
  PlatePoses crossed = Bend{}.poses(f.mount);
  crossed.plates[kTopPlate].displacement_mm.y() = -90;
  CHECK(soft.converge(crossed, 1e-4, 50).steps <= 50);
  for (const double coordinate : soft.node_mm()) CHECK(std::isfinite(coordinate));
}

TEST_CASE("soft newton: refuses poses that are not finite, and models whose plates are not free; does not allocate") {
  const Finger& f = finger();
  CHECK_THROWS_AS((SoftNewtonSolver<double>(f.exact.view(), f.mount)), InputError);
  SoftNewtonSolver<float> soft(f.soft.view(), f.mount);
  const PlatePoses good = Bend{3, 0, 0}.poses(f.mount);
  PlatePoses bad = good;
  bad.plates[kLowPlate].rotation_rad.x() = std::numeric_limits<float>::quiet_NaN();
  const long before = test::allocations;
  const auto refused = soft.converge(bad);
  soft.converge(good, 1e-2, 20);
  CHECK(test::allocations == before);
  CHECK(refused.steps == 0);
  CHECK_FALSE(refused.ok);
}
