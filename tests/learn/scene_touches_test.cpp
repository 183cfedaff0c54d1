#include "hostgen/learn/scene_touches.h"

#include <doctest/doctest.h>

#include "hostgen/learn/state_interpolant.h"
#include "tests/fem/box_mesh.h"

using namespace finsight;
using namespace finsight::host;

namespace {

FingerSpec grasped_column() {
  FingerSpec spec = test::small_finger_spec();
  spec.scenes[1] = {.name = "grasp", .friction = 0.5, .patch_radius_mm = 3, .line_share = 0.3};
  spec.trained_scene = "grasp";
  for (PoseNoise& noise : spec.noise) noise = {0.01, 0.05, 0.005, 0.001};
  return spec;
}

struct Column {
  FingerSpec spec = grasped_column();
  TetMesh mesh = test::small_finger_mesh();
  DatasetPlan plan = {.points = 300, .forces = 4, .scene = "grasp"};
  FemDataset dataset = make_dataset(spec, mesh, plan);
};

const Column& column() {
  static const Column made;
  return made;
}

}  // namespace

TEST_CASE("scene touches: force and moment belong together, up to a quarter beyond the largest force") {
  const Column& made = column();
  const TouchSource source = touches_of_scene(made.spec, made.plan);
  Random random(3);
  const std::vector<TouchSample> touches = source(made.dataset.states, {}, 300, random);
  REQUIRE(touches.size() == 300);
  int beyond = 0;
  for (const TouchSample& touch : touches) {
    CHECK(touch.force_n <= 1.25F * static_cast<float>(made.spec.force_n[1]));
    beyond += touch.force_n > 1.15F * static_cast<float>(made.spec.force_n[1]);
    CHECK(touch.numbers.allFinite());
    // Moment is arm times force wherever the force is of one contact.
    const Vec3f axes_n = touch.force_vector_n;  // the column's face looks along -z: normal z, across x, along y
    const Vec3f force_n(axes_n[1], axes_n[2], axes_n[0]);
    const Vec3f moment_nm = 1e-3F * (touch.point_mm + touch.displacement_mm).cross(force_n);
    CHECK((touch.moment_nm - moment_nm).norm() < 0.1F * moment_nm.norm() + 2e-4F);
  }
  CHECK(beyond > 5);
}

TEST_CASE("scene touches: some are of other scenes, and those elsewhere than on the face teach nothing of a point") {
  const Column& made = column();
  Random random(4);
  std::size_t unexplained = 0, elsewhere = 0;
  const std::vector<TouchSample> touches =
      touches_of_scene(made.spec, made.plan)(made.dataset.states, made.dataset.others, 400, random);
  for (const TouchSample& touch : touches) {
    unexplained += !touch.explained;
    elsewhere += !touch.on_face;
    CHECK((touch.on_face || !touch.explained));
  }
  CHECK(unexplained == 60);
  CHECK(elsewhere > 10);
  CHECK(elsewhere < 50);
}
