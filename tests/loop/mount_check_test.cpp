#include "firmware/loop/mount_check.h"

#include <doctest/doctest.h>

#include "firmware/vision/rigid_motion_fit.h"
#include "tests/vision/sight.h"

using namespace finsight;
using namespace finsight::test;

namespace {

constexpr double kFocalPx = 490, kScatterPx = 0.05;

/// Shows the check plates as a camera sees them, with a little noise.
bool show(MountCheck& check, const std::array<PlateMotion, kPlates>& plates, Random& random) {
  static const RigidMotionFitter body(test_mount(), kFocalPx);
  PlatePoses poses;
  poses.plates = plates;
  for (PlateMotion& plate : poses.plates) {
    for (float& x : plate.displacement_mm) x += static_cast<float>(0.03 * random.normal());
  }
  poses.seen = {true, true, true};
  poses.quality = Quality::kFresh;
  return check.update(poses, body.fit(sight_of(plates, kFocalPx, kScatterPx, random), {}));
}

bool after(MountCheck& check, int frames, const Eigen::Vector3d& t, const Eigen::Vector3d& w, Random& random) {
  bool moved = false;
  for (int n = 0; n < frames; ++n) moved = show(check, moved_as_one(t, w), random);
  return moved;
}

const Eigen::Vector3d kNothing = Eigen::Vector3d::Zero();

}  // namespace

TEST_CASE("mount check: notices a knocked camera once it stands still, and clears when it is back") {
  Random random(1);
  MountCheck check;
  CHECK_FALSE(after(check, 400, kNothing, kNothing, random));
  // The frames that count as a brief movement at first, and then all frames of standing still.
  const int frames = MountCheck::kBrief - 1 + MountCheck::kFrames;
  CHECK_FALSE(after(check, frames - 1, {2, 0.5, -1}, {0.01, 0, -0.03}, random));
  CHECK(after(check, 1, {2, 0.5, -1}, {0.01, 0, -0.03}, random));
  CHECK(after(check, 100, kNothing, kNothing, random));
  CHECK_FALSE(after(check, MountCheck::kFrames, kNothing, kNothing, random));
}

TEST_CASE("mount check: notices a camera that only turned, about any axis") {
  Random random(5);
  for (const Eigen::Vector3d& w : {Eigen::Vector3d(0.03, 0, 0), Eigen::Vector3d(0, 0.06, 0),
                                   Eigen::Vector3d(0, 0, -0.03), Eigen::Vector3d(0.15, 0, 0.1)}) {
    MountCheck check;
    CHECK(after(check, MountCheck::kFrames, kNothing, w, random));
  }
}

TEST_CASE("mount check: a gripper that moves a little now and then does not hide it") {
  Random random(4);
  MountCheck check;
  bool moved = false;
  for (int n = 0; n < 2 * MountCheck::kFrames; ++n) {
    moved = show(check, moved_as_one({n % 50 < 6 ? 5.0 : 2.0, 0.5, -1}, {0.01, 0, -0.03}), random);
  }
  CHECK(moved);
  check.reset();
  CHECK_FALSE(after(check, MountCheck::kFrames - 1, {2, 0.5, -1}, {0.01, 0, -0.03}, random));
}

TEST_CASE("mount check: notices a slow drift, too") {
  Random random(2);
  MountCheck check;
  bool moved = false;
  for (int n = 0; n < 20000; ++n) moved = show(check, moved_as_one({0, 0, 3e-4 * std::min(n, 8000)}, kNothing), random);
  CHECK(moved);
}

TEST_CASE("mount check: a long touch does not count as knocked, nor does a plate that is not seen") {
  Random random(3);
  const TestPrior prior;
  MountCheck check;
  for (int touch = 0; touch < 20; ++touch) {
    const auto plates = plate_motions(prior.draw(random, 1));
    for (int n = 0; n < MountCheck::kFrames + 1; ++n) CHECK_FALSE(show(check, plates, random));
  }
  for (int n = 0; n < 2 * MountCheck::kFrames; ++n) {
    PlatePoses poses;
    poses.seen = {true, false, true};
    poses.quality = Quality::kFresh;
    CHECK_FALSE(check.update(poses, RigidMotionFit{.size_mm = 4, .reprojection_px = 0, .unexplained_sq = 0}));
  }
}
