#include "firmware/loop/zero.h"

#include <doctest/doctest.h>

#include <Eigen/Geometry>
#include <random>

using namespace finsight;

namespace {

PlatePoses poses_at(float size, Quality quality = Quality::kFresh) {
  PlatePoses poses;
  for (int p = 0; p < kPlates; ++p) {
    poses.plates[p] = {{0.3F * size, -0.2F * size, size}, {0.02F * size, 0, 0.01F * size}};
    poses.seen[p] = true;
  }
  poses.quality = quality;
  return poses;
}

/// What comes of a zero on these frames, one after the other.
std::optional<bool> outcome(Zeroing& zeroing, PlatePoses poses, int frames) {
  for (int i = 0; i < frames; ++i) {
    PlatePoses frame = poses;
    zeroing.apply(frame);
    if (const auto done = zeroing.take_outcome()) return done;
  }
  return std::nullopt;
}

}  // namespace

TEST_CASE("zero: after 60 frames the finger's present pose is its rest") {
  Zeroing zeroing(3);
  zeroing.begin();
  CHECK_FALSE(outcome(zeroing, poses_at(1), 59));
  CHECK(outcome(zeroing, poses_at(1), 1) == true);
  PlatePoses poses = poses_at(1);
  zeroing.apply(poses);
  for (int p = 0; p < kPlates; ++p) {
    CHECK(poses.plates[p].displacement_mm.norm() < 1e-5F);
    CHECK(poses.plates[p].rotation_rad.norm() < 1e-3F);
  }
}

TEST_CASE("zero: later motions are those since the zero, turned about the plate's own centre") {
  Zeroing zeroing(3);
  ZeroPose zero{};
  zero[0] = {{0.5F, 0, 1}, {0.1F, 0, 0}};
  zeroing.set_zero(zero);
  // The plate as a body: from the zero it is turned by q and its centre moved by (1, 2, 3).
  const Eigen::AngleAxisf at_zero(0.1F, Vec3f::UnitX()), q(0.3F, Vec3f(1, 2, -1).normalized());
  const Eigen::AngleAxisf now(q.toRotationMatrix() * at_zero.toRotationMatrix());
  PlatePoses poses = poses_at(0);
  poses.plates[0] = {Vec3f(0.5F, 0, 1) + Vec3f(1, 2, 3), now.angle() * now.axis()};
  zeroing.apply(poses);
  CHECK((poses.plates[0].displacement_mm - Vec3f(1, 2, 3)).norm() < 1e-5F);
  CHECK((poses.plates[0].rotation_rad - 0.3F * q.axis()).norm() < 1e-5F);
}

TEST_CASE("zero: frames that show nothing are waited through, and after four seconds given up") {
  Zeroing zeroing(3);
  zeroing.begin();
  CHECK_FALSE(outcome(zeroing, poses_at(1, Quality::kInvalid), 180));
  CHECK(outcome(zeroing, poses_at(1), 60) == true);
  zeroing.begin();
  CHECK(outcome(zeroing, poses_at(1, Quality::kInvalid), 241) == false);
  CHECK(zeroing.zero());  // the old one stays
}

TEST_CASE("zero: a finger that is touched or moves meanwhile gets none") {
  Zeroing zeroing(3);
  zeroing.begin();
  CHECK(outcome(zeroing, poses_at(3.1F), 60) == false);
  zeroing.begin();
  CHECK_FALSE(outcome(zeroing, poses_at(1), 8));
  CHECK(outcome(zeroing, poses_at(1.4F), 12) == false);
  CHECK_FALSE(zeroing.zero());
}

TEST_CASE("zero: a still finger gets one at the noise that a spec states, however often it is asked") {
  // srm.toml's top plate: 0.010 mm across the line of sight, 0.090 mm along it. A sum of twelve uniform numbers is
  // nearly normal.
  std::minstd_rand random(1);
  const auto normal = [&] {
    float sum = -6;
    for (int i = 0; i < 12; ++i) sum += static_cast<float>(random() - random.min()) / 2147483646.0F;
    return sum;
  };
  for (int repeat = 0; repeat < 300; ++repeat) {
    Zeroing zeroing(3);
    zeroing.begin();
    std::optional<bool> done;
    while (!done) {
      PlatePoses poses = poses_at(1);
      for (PlateMotion& plate : poses.plates) {
        plate.displacement_mm += Vec3f(0.01F * normal(), 0.09F * normal(), 0.01F * normal());
      }
      zeroing.apply(poses);
      done = zeroing.take_outcome();
    }
    REQUIRE(*done);
  }
}

TEST_CASE("zero: it is measured from what the camera sees, not from the zero before") {
  Zeroing zeroing(3);
  for (const float size : {1.0F, 2.0F}) {
    zeroing.begin();
    CHECK(outcome(zeroing, poses_at(size), 60) == true);
    CHECK((*zeroing.zero())[0].displacement_mm.z() == doctest::Approx(size));
  }
}

TEST_CASE("zero: a missing plate is waited for, and not taken for a zero") {
  Zeroing zeroing(3);
  PlatePoses partly = poses_at(1);
  partly.seen[1] = false;
  zeroing.begin();
  CHECK_FALSE(outcome(zeroing, partly, Zeroing::kMaxFrames));
  CHECK(outcome(zeroing, partly, 1) == false);
  zeroing.begin();
  CHECK_FALSE(outcome(zeroing, partly, 100));
  CHECK(outcome(zeroing, poses_at(1), Zeroing::kFrames) == true);
}

TEST_CASE("zero: what is further than a touch may be is refused, and so is a zero while no frame comes") {
  Zeroing zeroing(1);  // poses_at(1) is 1.06 mm away
  zeroing.begin();
  CHECK(outcome(zeroing, poses_at(1), 1) == false);
  zeroing.begin();
  zeroing.cancel();
  CHECK(zeroing.take_outcome() == false);
  zeroing.cancel();  // nothing is being measured
  CHECK_FALSE(zeroing.take_outcome());
}
