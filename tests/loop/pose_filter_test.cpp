#include "firmware/loop/pose_filter.h"

#include <doctest/doctest.h>

#include <cmath>

#include "tests/random.h"

using namespace finsight;

namespace {

constexpr std::int64_t kPeriod_ns = 16'666'667;

PlatePoses poses_at(float z_mm) {
  PlatePoses poses;
  for (PlateMotion& plate : poses.plates) plate = {Vec3f(0, 0, z_mm), Vec3f(0.01F * z_mm, 0, 0)};
  poses.seen = {true, true, true};
  poses.quality = Quality::kFresh;
  return poses;
}

}  // namespace

TEST_CASE("pose filter: a steady motion is late by the delay") {
  PoseFilter filter(50);
  for (int frame = 0; frame < 100; ++frame) {
    PlatePoses poses = poses_at(0.1F * static_cast<float>(frame));
    filter.apply(poses, frame * kPeriod_ns);
    if (frame < 60) continue;
    const double late_mm = 0.1 * frame - static_cast<double>(poses.plates[1].displacement_mm.z());
    CHECK(late_mm * 1000 / 60 / 0.1 == doctest::Approx(50).epsilon(0.01));
    CHECK(static_cast<double>(poses.plates[2].rotation_rad.x()) ==
          doctest::Approx(0.01 * (0.1 * frame - late_mm)).epsilon(0.01));
  }
}

TEST_CASE("pose filter: noise shrinks as documented, and is not announced to") {
  PoseFilter filter(50);
  test::Random random(1);
  double square = 0;
  for (int frame = 0; frame < 20000; ++frame) {
    PlatePoses poses = poses_at(static_cast<float>(random.normal()));
    filter.apply(poses, frame * kPeriod_ns);
    if (frame < 100) continue;
    square += std::pow(static_cast<double>(poses.plates[0].displacement_mm.z()), 2) / 19900;
    CHECK(poses.noise[0] == 1);
  }
  CHECK(std::sqrt(square) == doctest::Approx(std::sqrt(16.67 / (2 * 50 + 16.67))).epsilon(0.05));
}

TEST_CASE("pose filter: a gap, another set of plates or a pause restarts it") {
  PoseFilter filter(50);
  const auto after = [&](PlatePoses poses, std::int64_t at_ns) {
    filter.apply(poses, at_ns);
    return poses.plates[0].displacement_mm.z();
  };
  CHECK(after(poses_at(1), 0) == 1);
  CHECK(after(poses_at(2), kPeriod_ns) < 2);
  CHECK(after(poses_at(2), kPeriod_ns + 300'000'000) == 2);
  PlatePoses two = poses_at(3);
  two.seen[2] = false;
  CHECK(after(two, kPeriod_ns + 310'000'000) == 3);
  CHECK(after(two, kPeriod_ns + 310'000'000) == 3);  // the same frame again
}

TEST_CASE("pose filter: without a delay and for held poses nothing changes") {
  PoseFilter none(0), some(50);
  for (int frame = 0; frame < 3; ++frame) {
    PlatePoses poses = poses_at(static_cast<float>(frame)), held = poses;
    none.apply(poses, frame * kPeriod_ns);
    CHECK(poses.plates[0].displacement_mm.z() == frame);
    CHECK(poses.noise[0] == 1);
    held.quality = Quality::kHeld;
    some.apply(held, frame * kPeriod_ns);
    CHECK(held.plates[0].displacement_mm.z() == frame);
  }
}
