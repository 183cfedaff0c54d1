#include "firmware/vision/mount_check.h"

#include <doctest/doctest.h>

#include "tests/vision/test_finger.h"

using namespace finsight;
using namespace finsight::test;

namespace {

/// Plates as a camera sees them that was moved by (t, w) about the finger's origin, with a little noise.
PlatePoses knocked(const Eigen::Vector3d& t, const Eigen::Vector3d& w, Random& random) {
  PlatePoses poses;
  for (std::size_t p = 0; p < kPlates; ++p) {
    const Eigen::Vector3d c = test_mount().T_finger_marker[p].translation().cast<double>();
    const Eigen::Vector3d noise(random.normal(), random.normal(), random.normal());
    poses.plates[p].displacement_mm = (t + w.cross(c) + 0.03 * noise).cast<float>();
    poses.plates[p].rotation_rad = (w + 0.002 * noise).cast<float>();
    poses.seen[p] = true;
  }
  poses.quality = Quality::kFresh;
  return poses;
}

bool after(MountCheck& check, int frames, const Eigen::Vector3d& t, const Eigen::Vector3d& w, Random& random) {
  bool moved = false;
  for (int n = 0; n < frames; ++n) moved = check.look(knocked(t, w, random));
  return moved;
}

const Eigen::Vector3d kNothing = Eigen::Vector3d::Zero();

}  // namespace

TEST_CASE("mount check: a camera that was knocked is noticed after it stood still, and forgiven when it is back") {
  Random random(1);
  MountCheck check(test_mount());
  CHECK_FALSE(after(check, 400, kNothing, kNothing, random));
  // What is at first taken for a brief movement, and then all of it anew.
  const int frames = MountCheck::kBrief - 1 + MountCheck::kFrames;
  CHECK_FALSE(after(check, frames - 1, {2, 0.5, -1}, {0.01, 0, -0.03}, random));
  CHECK(after(check, 1, {2, 0.5, -1}, {0.01, 0, -0.03}, random));
  CHECK(after(check, 100, kNothing, kNothing, random));
  CHECK_FALSE(after(check, MountCheck::kFrames, kNothing, kNothing, random));
}

TEST_CASE("mount check: a gripper that moves a little now and then does not hide it") {
  Random random(4);
  MountCheck check(test_mount());
  bool moved = false;
  for (int n = 0; n < 2 * MountCheck::kFrames; ++n) {
    moved = check.look(knocked({n % 50 < 6 ? 5.0 : 2.0, 0.5, -1}, {0.01, 0, -0.03}, random));
  }
  CHECK(moved);
  check.begin_anew();
  CHECK_FALSE(after(check, MountCheck::kFrames - 1, {2, 0.5, -1}, {0.01, 0, -0.03}, random));
}

TEST_CASE("mount check: a slow drift is noticed, too") {
  Random random(2);
  MountCheck check(test_mount());
  bool moved = false;
  for (int n = 0; n < 20000; ++n) moved = check.look(knocked({0, 0, 3e-4 * std::min(n, 8000)}, kNothing, random));
  CHECK(moved);
}

TEST_CASE("mount check: a touch that is held for long is none, nor is a plate that is not seen") {
  Random random(3);
  const TestPrior prior;
  MountCheck check(test_mount());
  for (int touch = 0; touch < 20; ++touch) {
    PlatePoses poses;
    poses.plates = plate_motions(prior.draw(random, 1));
    poses.seen = {true, true, true};
    poses.quality = Quality::kFresh;
    for (int n = 0; n < MountCheck::kFrames + 1; ++n) CHECK_FALSE(check.look(poses));
  }
  for (int n = 0; n < 2 * MountCheck::kFrames; ++n) {
    PlatePoses poses = knocked({0, 0, 4}, kNothing, random);
    poses.seen[1] = false;
    CHECK_FALSE(check.look(poses));
  }
}
