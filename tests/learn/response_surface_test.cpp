#include "hostgen/learn/response_surface.h"

#include <doctest/doctest.h>

#include "hostgen/learn/scene_touches.h"
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

/// RMS distance of the plates from where they are, of what the linear response or the surface say.
double error_mm(const std::vector<FemState>& states, const ResponseSurface* surface) {
  double sum_sq = 0;
  for (const FemState& state : states) {
    const PoseVector error = touch_sample(state).numbers - (surface ? surface->poses(state.linear) : state.linear);
    for (int p = 0; p < kPlates; ++p) sum_sq += static_cast<double>(error.segment<3>(6 * p).squaredNorm());
  }
  return std::sqrt(sum_sq / static_cast<double>(kPlates * states.size()));
}

}  // namespace

TEST_CASE("response surface: tells plates of contacts that it has not seen far better than the linear response") {
  std::vector<FemState> seen, unseen;
  for (const FemState& state : column().dataset.states) {
    if (state.valid()) (state.path % 4 == 1 ? unseen : seen).push_back(state);
  }
  REQUIRE(unseen.size() > 20);
  const ResponseSurface surface(seen, column().spec.noise);
  CHECK(error_mm(unseen, nullptr) > 0.05);
  CHECK(error_mm(unseen, &surface) < 0.25 * error_mm(unseen, nullptr));
}

TEST_CASE("response surface: a finger at rest is at rest") {
  const ResponseSurface surface(column().dataset.states, column().spec.noise);
  CHECK(surface.poses(PoseVector::Zero()) == PoseVector::Zero());
  CHECK(surface.displacement_mm(PoseVector::Zero()) == Vec3f::Zero());
}

TEST_CASE("response surface: too few states are refused") {
  const std::vector<FemState> few(column().dataset.states.begin(), column().dataset.states.begin() + 5);
  CHECK_THROWS_WITH_AS(ResponseSurface(few, column().spec.noise), doctest::Contains("too few"), std::runtime_error);
}

TEST_CASE("scene touches: force and moment belong together, up to a quarter beyond the largest force") {
  const Column& made = column();
  const auto finger = std::make_shared<const PushedFinger>(made.spec, made.mesh);
  const LinearResponse response(*finger);
  const TouchSource source = touches_of_scene(*finger, response, made.plan);
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
  const auto finger = std::make_shared<const PushedFinger>(made.spec, made.mesh);
  const LinearResponse response(*finger);
  Random random(4);
  std::size_t unexplained = 0, elsewhere = 0;
  const std::vector<TouchSample> touches =
      touches_of_scene(*finger, response, made.plan)(made.dataset.states, made.dataset.others, 400, random);
  for (const TouchSample& touch : touches) {
    unexplained += !touch.explained;
    elsewhere += !touch.on_face;
    CHECK((touch.on_face || !touch.explained));
  }
  CHECK(unexplained == 60);
  CHECK(elsewhere > 10);
  CHECK(elsewhere < 50);
}

TEST_CASE("response surface: tells the change from one force of a path to the next") {
  const Column& made = column();
  std::vector<FemState> valid;
  for (const FemState& state : made.dataset.states) {
    if (state.valid()) valid.push_back(state);
  }
  const ResponseSurface surface(valid, made.spec.noise);
  double worst_mm = 0, moved_mm = 0;
  for (std::size_t i = 1; i < valid.size(); ++i) {
    if (valid[i].path != valid[i - 1].path) continue;
    const PoseVector from = touch_sample(valid[i - 1]).numbers, to = touch_sample(valid[i]).numbers;
    const PoseVector told = from + surface.poses(valid[i].linear) - surface.poses(valid[i - 1].linear);
    worst_mm = std::max(worst_mm, static_cast<double>((told - to).segment<3>(0).norm()));
    moved_mm = std::max(moved_mm, static_cast<double>((from - to).segment<3>(0).norm()));
  }
  CHECK(moved_mm > 0.5);
  CHECK(worst_mm < 0.1 * moved_mm);
}
