#include "firmware/loop/grip_watch.h"

#include <doctest/doctest.h>

#include <random>

using namespace finsight;

namespace {

/// A gripped object with noise in touch and deformation.
struct Grip {
  Vec3f point_mm = Vec3f(0, 60, 0);
  float deformation_mm = 3, noise_mm = 0.02F, touch_noise_mm = 0.1F;
  float changes = 3;
  bool in_contact = true;
  Quality touch_quality = Quality::kFresh;
  GripWatch watch;
  std::mt19937 random{7};

  bool frame() {
    std::normal_distribution<float> normal;
    Touch touch;
    for (int axis = 0; axis < 3; ++axis) touch.point_mm[axis] = point_mm[axis] + touch_noise_mm * normal(random);
    touch.radius_68_mm = 0.8F;
    touch.quality = touch_quality;
    return watch.update(in_contact, touch, deformation_mm + noise_mm * normal(random), changes);
  }
  int frames(int count) {
    int changed = 0;
    for (int i = 0; i < count; ++i) changed += frame();
    return changed;
  }
};

}  // namespace

TEST_CASE("grip watch: an hour of a steady grip with white noise is no change") {
  Grip grip;
  CHECK(grip.frames(3600 * 60) == 0);
  CHECK(grip.watch.is_steady());
}

TEST_CASE("grip watch: a deformation that gives way by more than its deviations is one change") {
  Grip grip;
  grip.frames(200);
  grip.deformation_mm -= 0.02F;  // 1 deviation
  CHECK(grip.frames(200) == 0);
  grip.deformation_mm -= 0.08F;  // 5 deviations
  CHECK(grip.frames(200) == 1);
  CHECK(grip.watch.is_steady());
  CHECK(grip.frames(200) == 0);
}

TEST_CASE("grip watch: a touch that moves by more than its radii is one change") {
  Grip grip;
  grip.frames(200);
  grip.point_mm.x() += 1.6F;  // 2 radii
  CHECK(grip.frames(200) == 0);
  grip.point_mm.x() += 1.6F;
  CHECK(grip.frames(200) == 1);
}

TEST_CASE("grip watch: while the gripper closes there is nothing to compare with") {
  Grip grip;
  for (int i = 0; i < 300; ++i) {
    grip.deformation_mm += 0.02F;  // 1.2 mm/s
    CHECK_FALSE(grip.frame());
    CHECK_FALSE(grip.watch.is_steady());
  }
  CHECK(grip.frames(100) == 0);
  CHECK(grip.watch.is_steady());
}

TEST_CASE("grip watch: letting go is no change, and the next grip is compared with itself") {
  Grip grip;
  grip.frames(100);
  grip.in_contact = false;
  grip.deformation_mm = 0;
  CHECK(grip.frames(10) == 0);
  CHECK_FALSE(grip.watch.is_steady());
  grip.in_contact = true;
  grip.deformation_mm = 5;
  CHECK(grip.frames(100) == 0);
  CHECK(grip.watch.is_steady());
}

TEST_CASE("grip watch: without a touch the deformation alone is watched, and 0 watches nothing") {
  Grip grip;
  grip.touch_quality = Quality::kInvalid;
  grip.frames(100);
  grip.point_mm.x() += 50;
  CHECK(grip.frames(100) == 0);
  grip.deformation_mm += 1;
  CHECK(grip.frames(100) == 1);
  grip.changes = 0;
  grip.deformation_mm += 1;
  CHECK(grip.frames(100) == 0);
  CHECK_FALSE(grip.watch.is_steady());
}
