#include "hostgen/fem/statics.h"

#include <doctest/doctest.h>

#include <array>
#include <cmath>
#include <memory>

#include "tests/fem/box_mesh.h"

using namespace finsight;
using namespace finsight::host;

namespace {

/// The tets whose middles are higher are of the three plates in turn.
void put_plates_above(double height_mm, TetMesh& mesh) {
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    double y_mm = 0;
    for (const int node : mesh.tets[t]) y_mm += mesh.node_mm[static_cast<std::size_t>(node)][1] / 4;
    if (y_mm > height_mm) mesh.region[t] = kFirstPlateRegion + static_cast<int>(t % 3);
  }
}

}  // namespace

TEST_CASE("statics: a slender column bends as beam theory says") {
  // 60 mm high, 12 x 6 mm, pushed at the end: F L^3 / (3 E I) plus shear 1.2 F L / (G A).
  FingerSpec spec = test::small_finger_spec();
  TetMesh mesh = test::box_mesh({{-6, 0, 0}, {12, 60, 6}, {2, 16, 2}});
  put_plates_above(56.3, mesh);
  spec.plate_stiffness_ratio = 1;
  FingerStatics finger(spec, mesh);
  const double force_n = 0.01;
  REQUIRE(finger.load(Vec3f(0, 60, 0), force_n));
  const FemState state = finger.state();
  const double inertia = 12 * 6 * 6 * 6 / 12.0, area = 12 * 6, E = 10, G = E / (2 * 1.47);
  const double theory_mm = force_n * 60 * 60 * 60 / (3 * E * inertia) + 1.2 * force_n * 60 / (G * area);
  CHECK(state.contact_mm.z() - state.point_mm.z() == doctest::Approx(theory_mm).epsilon(0.04));
}

TEST_CASE("statics: rubber bends nearly as far on a coarse mesh as on a fine one") {
  FingerSpec spec = test::small_finger_spec();
  spec.plate_stiffness_ratio = 1;
  spec.poisson_ratio = 0.49;
  const auto bent_mm = [&](const std::array<int, 3>& cells, Element element) {
    TetMesh mesh = test::box_mesh({{-6, 0, 0}, {12, 60, 4}, cells});
    put_plates_above(54, mesh);
    FingerStatics finger(std::make_shared<const PushedFinger>(spec, mesh, element));
    REQUIRE(finger.load(Vec3f(0, 60, 0), 0.01));
    return static_cast<double>(finger.state().contact_mm.z() - finger.state().point_mm.z());
  };
  const std::array<int, 3> coarse = {2, 10, 1}, fine = {4, 24, 3};
  const double true_mm = bent_mm(fine, Element::kSelective);
  CHECK(bent_mm(fine, Element::kC3D10) == doctest::Approx(true_mm).epsilon(0.01));
  CHECK(bent_mm(coarse, Element::kSelective) == doctest::Approx(true_mm).epsilon(0.03));
  CHECK(bent_mm(coarse, Element::kC3D10) < 0.9 * true_mm);
}

TEST_CASE("statics: more force pushes further, and the state does not depend on the load path") {
  const FingerSpec spec = test::small_finger_spec();
  const TetMesh mesh = test::small_finger_mesh();
  FingerStatics stepwise(spec, mesh), direct(spec, mesh);
  const Vec3f point(2, 40, 0);
  float before_mm = 0;
  for (const double force_n : {0.1, 0.2, 0.3}) {
    REQUIRE(stepwise.load(point, force_n));
    const float push_mm = (stepwise.state().contact_mm - point).norm();
    CHECK(push_mm > before_mm);
    before_mm = push_mm;
  }
  REQUIRE(direct.load(point, 0.3));
  CHECK((direct.state().contact_mm - stepwise.state().contact_mm).norm() < 1e-4);
  // Moving the touch along the face ends where a fresh load does.
  REQUIRE(stepwise.load(Vec3f(-2, 50, 0), 0.2));
  direct.reset();
  REQUIRE(direct.load(Vec3f(-2, 50, 0), 0.2));
  for (int p = 0; p < kPlates; ++p) {
    CHECK((direct.state().plates[p].displacement_mm - stepwise.state().plates[p].displacement_mm).norm() < 1e-4);
  }
}

TEST_CASE("statics: a touch that moved along the face can be weakened") {
  // The move changes the load a lot and the shape little; weakening the force then must not count as a jump.
  FingerStatics finger(test::small_finger_spec(), test::small_finger_mesh());
  REQUIRE(finger.load(Vec3f(-2, 40, 0), 0.3));
  for (const float x_mm : {-1.0f, 0.0f, 1.0f, 2.0f}) REQUIRE(finger.load(Vec3f(x_mm, 40, 0), 0.3));
  CHECK(finger.load(Vec3f(2, 40, 0), 0.2));
}

TEST_CASE("statics: other contacts lead where they would have led from rest") {
  FingerSpec spec = test::small_finger_spec();
  spec.density_kg_m3 = 1200;
  FingerStatics stepwise(spec, test::small_finger_mesh()), direct(spec, test::small_finger_mesh());
  const Eigen::Vector3d felt_g(0.3, 0, 1);
  const FaceContact first{.centre_mm = {1, 40}, .friction = {0.3, -0.5}, .follow = 1},
      second{.centre_mm = {-2, 50}, .radius_mm = 3, .full_force_n = 0.3, .friction = {-0.4, 0.2}, .follow = 0.5},
      third{.centre_mm = {0, 45}, .share = 0.4}, fourth{.centre_mm = {2, 30}, .share = 0.6};
  stepwise.begin({first}, felt_g);
  REQUIRE(stepwise.press(0.1));
  REQUIRE(stepwise.press({second}, 0.2));
  REQUIRE(stepwise.press({third, fourth}, 0.25));
  REQUIRE(stepwise.press({second}, 0.3));
  direct.begin({second}, felt_g);
  REQUIRE(direct.press(0.3));
  const FemState a = stepwise.state(), b = direct.state();
  CHECK((a.contact_mm - b.contact_mm).norm() < 0.002F);  // where the force turned to, to half a degree
  CHECK((a.force_vector_n - b.force_vector_n).norm() < 0.003F);
  for (int p = 0; p < kPlates; ++p) {
    CHECK((a.plates[p].displacement_mm - b.plates[p].displacement_mm).norm() < 0.01F);
  }
  CHECK_FALSE(stepwise.press({first}, 1e6));
  CHECK(stepwise.state().contact_mm == a.contact_mm);
  CHECK(stepwise.state().force_n == a.force_n);
  CHECK(stepwise.press({second}, 0.2));
}

TEST_CASE("statics: a bent finger answers to acceleration as its equilibria do") {
  FingerSpec spec = test::small_finger_spec();
  spec.density_kg_m3 = 1200;
  FingerStatics statics(spec, test::small_finger_mesh());
  const FaceContact contact{.centre_mm = {1, 40}, .friction = {0.3, -0.5}, .follow = 0};
  const Eigen::Vector3d felt_g(0.3, 0, 1);
  const auto plates_at = [&](const Eigen::Vector3d& g) {
    REQUIRE(statics.begin({contact}, g));
    REQUIRE(statics.press(0.2));
    return pose_vector(PlatePoses{.plates = statics.state().plates}).cast<double>().eval();
  };
  constexpr double kStep_g = 0.1;
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d step_g = kStep_g * Eigen::Vector3d::Unit(axis);
    const PoseVectorOf<double> expected = (plates_at(felt_g + step_g) - plates_at(felt_g - step_g)) / (2 * kStep_g);
    plates_at(felt_g);
    const std::optional<MotionPerG> per_g = statics.motion_per_g();
    REQUIRE(per_g);
    CHECK((per_g->col(axis) - expected).norm() < 0.02 * expected.norm());
  }
}

TEST_CASE("statics: states nearby are those that their loads lead to from rest, to first order") {
  FingerSpec spec = test::small_finger_spec();
  spec.density_kg_m3 = 1200;
  FingerStatics near(spec, test::small_finger_mesh()), direct(spec, test::small_finger_mesh());
  const Eigen::Vector3d felt_g(0.3, 0, 1);
  const FaceContact contact{
      .centre_mm = {1, 40}, .radius_mm = 2, .full_force_n = 0.3, .friction = {0.3, -0.5}, .follow = 0};
  FaceContact moved = contact, rubbed = contact;
  moved.centre_mm += Eigen::Vector2d(-0.5, 1);
  moved.radius_mm = 1;
  rubbed.friction = {0.2, -0.3};
  near.begin({contact}, felt_g);
  REQUIRE(near.press(0.2));
  const FemState before = near.state();
  const std::vector<FingerStatics::OtherLoad> loads = {{{moved}, 0.21}, {{rubbed}, 0.19}, {{contact}, 0.2}};
  const std::vector<FemState> nearby = near.nearby(loads);
  REQUIRE(nearby.size() == 3);
  for (std::size_t i = 0; i < 3; ++i) {
    direct.begin(loads[i].contacts, felt_g);
    REQUIRE(direct.press(loads[i].normal_n));
    const FemState expected = direct.state();
    CHECK(nearby[i].force_n == expected.force_n);
    CHECK((nearby[i].point_mm - expected.point_mm).norm() < 1e-5F);
    CHECK((nearby[i].force_vector_n - expected.force_vector_n).norm() < 1e-5F);
    CHECK((nearby[i].moment_nmm - expected.moment_nmm).norm() < 0.02F);
    for (std::size_t p = 0; p < kPlates; ++p) {
      const PlateMotion &from = before.plates[p], &to = expected.plates[p], &found = nearby[i].plates[p];
      CHECK((found.displacement_mm - to.displacement_mm).norm() <
            0.05F * (from.displacement_mm - to.displacement_mm).norm() + 1e-4F);
      CHECK((found.rotation_rad - to.rotation_rad).norm() <
            0.05F * (from.rotation_rad - to.rotation_rad).norm() + 1e-5F);
    }
  }
  CHECK((nearby[0].contact_mm - before.contact_mm).norm() > 0.1F);
  CHECK(near.state().contact_mm == before.contact_mm);
  CHECK(near.press(0.25));
}

TEST_CASE("statics: a force that the finger cannot bear leaves the last good state") {
  FingerStatics finger(test::small_finger_spec(), test::small_finger_mesh());
  REQUIRE(finger.load(Vec3f(0, 40, 0), 0.2));
  const FemState good = finger.state();
  CHECK_FALSE(finger.load(Vec3f(0, 40, 0), 1e6));
  CHECK(finger.state().contact_mm == good.contact_mm);
  CHECK(finger.state().force_n == good.force_n);
}

TEST_CASE("statics: a column that buckles is told apart from a load that the solver cannot follow") {
  // Under its own weight a column 60 mm high, 12 x 6 mm, buckles at 7.84 E I / L^2 (Greenhill 1881): 96 times gravity.
  FingerSpec spec = test::small_finger_spec();
  TetMesh mesh = test::box_mesh({{-6, 0, 0}, {12, 60, 6}, {2, 16, 2}});
  put_plates_above(56.3, mesh);
  spec.plate_stiffness_ratio = 1;
  spec.density_kg_m3 = 1150;
  FingerStatics finger(spec, mesh);
  FaceContact contact;
  contact.centre_mm = {0, 50};
  CHECK(finger.begin({contact}, {0, -80, 0}));
  CHECK_FALSE(finger.begin({contact}, {0, -120, 0}));
  CHECK(finger.buckled());
  REQUIRE(finger.begin({contact}));
  CHECK_FALSE(finger.press(1e6));
  CHECK_FALSE(finger.buckled());
}
