#include "hostgen/render/touch_path.h"

#include <doctest/doctest.h>

#include <cmath>

#include "hostgen/fem/statics.h"

using namespace finsight;
using namespace finsight::host;

namespace {

constexpr double kFramesPerSecond = 60;

FingerSpec default_spec() { return read_finger_spec(FINSIGHT_SOURCE_DIR "/hostgen/fingers/srm.toml"); }

}  // namespace

TEST_CASE("touch plan: the point stays on the touchable face, wanders over much of it, and moves smoothly") {
  const FingerSpec spec = default_spec();
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    CAPTURE(seed);
    const TouchPlan plan(spec, 12, seed);
    double least_y_mm = 1e9, most_y_mm = -1e9, widest_x_mm = 0, fastest_mm_s = 0, sharpest_mm_s2 = 0;
    const double dt = 1 / kFramesPerSecond;
    for (int frame = 1; frame < 719; ++frame) {
      const Vec3f point = plan.point_mm(frame * dt), before = plan.point_mm((frame - 1) * dt),
                  after = plan.point_mm((frame + 1) * dt);
      CHECK(point.y() >= spec.touch_y_mm[0]);
      CHECK(point.y() <= spec.touch_y_mm[1]);
      CHECK(std::abs(point.x()) <= spec.half_width.at(point.y()) - spec.touch_edge_mm);
      CHECK(point.z() == doctest::Approx(spec.front_z.at(point.y())));
      least_y_mm = std::min<double>(least_y_mm, point.y());
      most_y_mm = std::max<double>(most_y_mm, point.y());
      widest_x_mm = std::max<double>(widest_x_mm, std::abs(point.x()));
      fastest_mm_s = std::max<double>(fastest_mm_s, (after - before).norm() / (2 * dt));
      sharpest_mm_s2 = std::max<double>(sharpest_mm_s2, (after - 2 * point + before).norm() / (dt * dt));
    }
    CHECK(most_y_mm - least_y_mm > 40);
    CHECK(widest_x_mm > 8);
    CHECK(fastest_mm_s < 100);
    CHECK(sharpest_mm_s2 < 400);
  }
}

TEST_CASE("touch plan: the paper's four paths run around the middle of the face twice, under one force") {
  const FingerSpec spec = default_spec();
  const double middle_mm = (spec.touch_y_mm[0] + spec.touch_y_mm[1]) / 2, seconds = 8;
  for (const auto& named : touch_paths()) {
    const TouchPlan::Path path = named.second;
    using Path = TouchPlan::Path;
    if (path == Path::kWander || path == Path::kFast || path == Path::kRest) continue;
    CAPTURE(named.first);
    const TouchPlan plan(spec, seconds, 1, path);
    CHECK((plan.point_mm(0) - plan.point_mm(seconds / 2)).norm() < 1e-3F);
    CHECK((plan.point_mm(1) - plan.point_mm(1 + seconds / 2)).norm() < 1e-3F);
    CHECK(plan.force_n(0) == 0);
    CHECK(plan.force_n(seconds / 3) == doctest::Approx(0.6 * spec.force_n[1]));
    CHECK(plan.force_n(seconds) == 0);
    double widest_mm = 0, highest_mm = 0, longest_step_mm = 0;
    for (int k = 0; k < 800; ++k) {
      const Vec3f point = plan.point_mm(k * seconds / 800), next = plan.point_mm((k + 1) * seconds / 800);
      CHECK(std::abs(point.x()) <= spec.half_width.at(point.y()) - spec.touch_edge_mm);
      CHECK(point.z() == doctest::Approx(spec.front_z.at(point.y())));
      widest_mm = std::max<double>(widest_mm, std::abs(point.x()));
      highest_mm = std::max<double>(highest_mm, std::abs(point.y() - middle_mm));
      longest_step_mm = std::max<double>(longest_step_mm, (next - point).norm());
    }
    CHECK(widest_mm > 8);
    CHECK(highest_mm > 8);
    CHECK(longest_step_mm < 1);
  }
}

TEST_CASE("touch plan: at rest nothing touches the finger") {
  const TouchPlan plan(default_spec(), 8, 1, TouchPlan::Path::kRest);
  for (int k = 0; k <= 80; ++k) CHECK(plan.force_n(0.1 * k) == 0);
}

TEST_CASE(
    "touch plan: the force starts and ends at zero, reaches the largest force and never exceeds it, and pauses between "
    "presses") {
  const FingerSpec spec = default_spec();
  for (const double seconds : {0.5, 3.0, 10.0, 12.0, 60.0}) {
    CAPTURE(seconds);
    const TouchPlan plan(spec, seconds, 5);
    const int steps = static_cast<int>(seconds * 600);
    double largest_n = 0, jump_n = 0;
    int lift_offs = 0;
    for (int step = 0; step <= steps; ++step) {
      const double force_n = plan.force_n(step / 600.0), before_n = plan.force_n((step - 1) / 600.0);
      CHECK(force_n >= 0);
      largest_n = std::max(largest_n, force_n);
      jump_n = std::max(jump_n, std::abs(force_n - before_n));
      if (plan.point_mm(step / 600.0).y() > spec.touch_y_mm[1] - 10) CHECK(force_n < 0.65 * spec.force_n[1]);
      lift_offs += force_n == 0 && before_n > 0;
    }
    CHECK(plan.force_n(0) == 0);
    CHECK(plan.force_n(seconds) == 0);
    CHECK(plan.force_n(-1) == 0);
    CHECK(plan.force_n(seconds + 1) == 0);
    CHECK(largest_n <= spec.force_n[1]);
    CHECK(largest_n > 0.5 * spec.force_n[1]);
    CHECK(jump_n < spec.force_n[1] * 20 / (600 * std::min(seconds, 4.0)));
    CHECK(lift_offs >= std::lround(seconds / 4));
    CHECK(lift_offs >= 1);
  }
}

TEST_CASE("touch plan: the seed decides everything") {
  const FingerSpec spec = default_spec();
  const TouchPlan one(spec, 12, 1), same(spec, 12, 1), other(spec, 12, 2);
  CHECK(one.point_mm(3.7) == same.point_mm(3.7));
  CHECK(one.force_n(7.7) == same.force_n(7.7));
  CHECK(one.point_mm(3.7) != other.point_mm(3.7));
  CHECK(one.force_n(7.7) != other.force_n(7.7));
}

TEST_CASE("interpolated: passes through the solved states, follows a parabola between them, rests exactly at rest") {
  constexpr int kStep = 4;
  const auto parabola = [](double frame) { return static_cast<float>(0.5 + 0.3 * frame + 0.02 * frame * frame); };
  std::vector<FemState> keys(8);
  for (int k = 0; k < 8; ++k) {
    keys[k].force_n = k < 2 ? 0 : 1;
    keys[k].point_mm = keys[k].contact_mm = Vec3f(0, parabola(kStep * k), 0);
    if (k >= 2) keys[k].plates[kLowPlate].rotation_rad.z() = parabola(kStep * k);
  }
  const std::vector<FemState> states = interpolated(keys, kStep, 28);
  REQUIRE(states.size() == 28);
  for (int frame = 0; frame < 28; ++frame) {
    CAPTURE(frame);
    CHECK(states[frame].path == frame);
    CHECK(states[frame].force_n >= 0);
    if (frame >= 4 && frame <= 24) CHECK(states[frame].point_mm.y() == doctest::Approx(parabola(frame)));
    if (frame >= 12 && frame <= 24)
      CHECK(states[frame].plates[kLowPlate].rotation_rad.z() == doctest::Approx(parabola(frame)));
    if (frame > 4) continue;
    CHECK(states[frame].force_n == 0);
    CHECK(states[frame].plates[kLowPlate].rotation_rad == Vec3f::Zero());
    CHECK(states[frame].contact_mm == states[frame].point_mm);
  }
}

TEST_CASE("touch path: solved and interpolated frames are the equilibria of their own touch") {
  const FingerSpec spec = default_spec();
  const TetMesh mesh = make_mesh(spec, MeshSize::kCoarse);
  // Five frames in the middle of a press; two are solved by the path, all of them here from rest.
  const TouchPlan plan(spec, 4, 3);
  constexpr int kFrames = 60;
  const std::vector<FemState> states = make_touch_path(spec, mesh, plan, kFrames, kFramesPerSecond);
  REQUIRE(states.size() == kFrames);
  CHECK(states[0].force_n == 0);
  CHECK(states[0].plates[kTopPlate].displacement_mm == Vec3f::Zero());
  FingerStatics finger(spec, mesh);
  for (const int frame : {30, 32, 48, 57}) {
    CAPTURE(frame);
    const double time_s = frame / kFramesPerSecond;
    finger.reset();
    REQUIRE(finger.load(plan.point_mm(time_s), plan.force_n(time_s)));
    const FemState expected = finger.state();
    CHECK(std::abs(states[frame].force_n - expected.force_n) < 0.01);
    CHECK((states[frame].point_mm - expected.point_mm).norm() < 0.05);
    CHECK((states[frame].contact_mm - expected.contact_mm).norm() < 0.1);
    for (int plate = 0; plate < kPlates; ++plate) {
      const PlateMotion &found = states[frame].plates[plate], &wanted = expected.plates[plate];
      CHECK((found.displacement_mm - wanted.displacement_mm).norm() < (frame % 4 == 0 ? 1e-4 : 0.03));
      CHECK((found.rotation_rad - wanted.rotation_rad).norm() < (frame % 4 == 0 ? 1e-5 : 0.002));
    }
    CHECK(expected.plates[kTopPlate].displacement_mm.norm() > 0.2);
  }
}
