#include "hostgen/fem/contact_twin.h"

#include <doctest/doctest.h>

#include "tests/fem/box_mesh.h"

using namespace finsight;
using namespace finsight::host;

namespace {

const Scene kRubbing = {.name = "grasp", .friction = 0.6, .patch_radius_mm = 3};

FingerSpec noisy_spec() {
  FingerSpec spec = test::small_finger_spec();
  for (PoseNoise& noise : spec.noise) noise = {0.001, 0.001, 0.0001, 0.0001};
  return spec;
}

FemState state_under(FingerStatics& finger, const std::vector<FaceContact>& contacts, double normal_n) {
  REQUIRE(finger.begin(contacts));
  REQUIRE(finger.press(normal_n));
  return finger.state();
}

}  // namespace

TEST_CASE("contact twin: of a contact that rubs it is that contact") {
  const FingerSpec spec = noisy_spec();
  FingerStatics finger(spec, test::small_finger_mesh());
  const FaceContact contact{
      .centre_mm = {2, 38}, .radius_mm = 2, .pressure = Pressure::kEven, .friction = {0.3, -0.2}, .follow = 0};
  const FemState state = state_under(finger, {contact}, 0.3);
  const ContactTwin twin = closest_contact(finger, spec, kRubbing, state);
  CHECK(twin.distance < 0.5);
  CHECK((twin.state.point_mm - state.point_mm).norm() < 0.1f);
  CHECK((twin.state.force_vector_n - state.force_vector_n).norm() < 0.01f);
}

TEST_CASE("contact twin: nothing that touches the face moves the plates as a push at the back does") {
  const FingerSpec spec = noisy_spec();
  FingerStatics finger(spec, test::small_finger_mesh());
  const FemState state = state_under(finger, {{.side = Side::kBack, .centre_mm = {0, 40}}}, 0.3);
  CHECK(closest_contact(finger, spec, kRubbing, state).distance > 20);
}

TEST_CASE("contact twin: a test that refuses one frame in a thousand finds what is far away, and no twin") {
  CHECK(largest_share_refused(0) == doctest::Approx(0.001).epsilon(0.01));
  CHECK(largest_share_refused(3.0902) == doctest::Approx(0.5));
  CHECK(largest_share_refused(10) == doctest::Approx(1));
}
