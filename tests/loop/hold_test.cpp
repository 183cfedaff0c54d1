#include "firmware/loop/hold.h"

#include <doctest/doctest.h>

using namespace finsight;

namespace {

constexpr std::int64_t kMs = 1'000'000;

PlatePoses fresh_poses(float z_mm) {
  PlatePoses poses;
  poses.plates[kTopPlate].displacement_mm = Vec3f(0, 0, z_mm);
  poses.seen = {true, true, true};
  poses.quality = Quality::kFresh;
  return poses;
}

Touch touch_at(float y_mm) {
  Touch touch;
  touch.point_mm = Vec3f(0, y_mm, 0);
  touch.quality = Quality::kFresh;
  return touch;
}

FingerShape solved_shape(bool fallback = false) {
  FingerShape shape;
  shape.source = ShapeSource::kMap;
  shape.fallback = fallback;
  shape.quality = Quality::kFresh;
  return shape;
}

RuntimeSettings holding(std::uint16_t ms, std::uint16_t after = 0) {
  RuntimeSettings settings;
  settings[kHoldTime] = ms;
  settings[kAfterHold] = after;
  return settings;
}

}  // namespace

TEST_CASE("hold: what is fresh passes as it is") {
  Hold hold;
  const PlatePoses& poses = hold.poses(fresh_poses(3), kMs, holding(100));
  CHECK(poses.quality == Quality::kFresh);
  CHECK(hold.shape(solved_shape()).quality == Quality::kFresh);
  CHECK(hold.touch(touch_at(40)).quality == Quality::kFresh);
  CHECK_FALSE(hold.is_over());
}

TEST_CASE("hold: before anything was measured all is invalid and the hold is over") {
  Hold hold;
  CHECK(hold.poses(PlatePoses{}, kMs, holding(100)).quality == Quality::kInvalid);
  CHECK(hold.shape(solved_shape()).quality == Quality::kInvalid);
  CHECK(hold.touch(touch_at(40)).quality == Quality::kInvalid);
  CHECK(hold.is_over());
}

TEST_CASE("hold: within the hold time poses, shape and touch are held together, with the plates that are seen now") {
  Hold hold;
  hold.poses(fresh_poses(3), kMs, holding(100));
  hold.touch(touch_at(40));
  for (const std::int64_t ms : {17, 50, 101}) {
    const PlatePoses& poses = hold.poses(PlatePoses{}, ms * kMs, holding(100));
    CHECK(poses.quality == Quality::kHeld);
    CHECK(poses.plates[kTopPlate].displacement_mm.z() == 3);
    CHECK(poses.seen_count() == 0);
    CHECK(hold.shape(solved_shape()).quality == Quality::kHeld);
    const Touch& touch = hold.touch(Touch{});
    CHECK(touch.quality == Quality::kHeld);
    CHECK(touch.point_mm.y() == 40);
    CHECK_FALSE(hold.is_over());
  }
}

TEST_CASE("hold: after the hold time everything is invalid, and comes back only with fresh poses") {
  Hold hold;
  hold.poses(fresh_poses(3), kMs, holding(100));
  hold.touch(touch_at(40));
  CHECK(hold.poses(PlatePoses{}, 102 * kMs, holding(100)).quality == Quality::kInvalid);
  CHECK(hold.is_over());
  CHECK(hold.touch(Touch{}).quality == Quality::kInvalid);
  CHECK(hold.poses(PlatePoses{}, 103 * kMs, holding(1000, 1)).quality == Quality::kInvalid);
  CHECK(hold.poses(fresh_poses(2), 104 * kMs, holding(100)).quality == Quality::kFresh);
  CHECK_FALSE(hold.is_over());
}

TEST_CASE("hold: where the settings want it, values stay held after the hold time, which is over all the same") {
  Hold hold;
  hold.poses(fresh_poses(3), kMs, holding(100, 1));
  hold.touch(touch_at(40));
  CHECK(hold.poses(PlatePoses{}, 5000 * kMs, holding(100, 1)).quality == Quality::kHeld);
  CHECK(hold.touch(Touch{}).quality == Quality::kHeld);
  CHECK(hold.is_over());
}

TEST_CASE("hold: an older touch never comes back when the last fresh poses told of none") {
  Hold hold;
  hold.poses(fresh_poses(3), kMs, holding(100, 1));
  hold.touch(touch_at(40));
  hold.poses(fresh_poses(3), 17 * kMs, holding(100, 1));
  hold.touch(Touch{});  // the plates moved as one body
  hold.poses(PlatePoses{}, 33 * kMs, holding(100, 1));
  CHECK(hold.touch(Touch{}).quality == Quality::kInvalid);
}

TEST_CASE("hold: a shape that is a fallback counts as held, and one that does not exist as invalid") {
  Hold hold;
  hold.poses(fresh_poses(3), kMs, holding(100));
  CHECK(hold.shape(solved_shape(true)).quality == Quality::kHeld);
  CHECK(hold.shape(FingerShape{}).quality == Quality::kInvalid);
}

TEST_CASE("hold: after a reset nothing is held") {
  Hold hold;
  hold.poses(fresh_poses(3), kMs, holding(100));
  hold.touch(touch_at(40));
  hold.reset();
  CHECK(hold.poses(PlatePoses{}, 2 * kMs, holding(100)).quality == Quality::kInvalid);
  CHECK(hold.is_over());
}
