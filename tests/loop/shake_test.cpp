#include "firmware/loop/shake.h"

#include <doctest/doctest.h>

#include <cmath>

using namespace finsight;

namespace {

PlatePoses top_at(float z_mm) {
  PlatePoses poses;
  poses.plates[kTopPlate].displacement_mm = Vec3f(0, 0, z_mm);
  poses.seen = {true, true, true};
  poses.quality = Quality::kFresh;
  return poses;
}

}  // namespace

TEST_CASE("shake: a touch that comes fast and steadily does not count, a swing is as large as its second difference") {
  Shake shake;
  std::uint32_t frame = 1000;
  for (int i = 0; i < 20; ++i) CHECK(shake.update(top_at(0.7F * static_cast<float>(i)), frame++) == 0);
  Shake swung;
  float largest_mm = 0;
  for (int i = 0; i < 20; ++i) {
    largest_mm = swung.update(top_at(3 * std::sin(2 * 3.14159265F * 12 / 60 * static_cast<float>(i))), frame++);
  }
  CHECK(largest_mm == doctest::Approx(3 * 4 * std::pow(std::sin(3.14159265 * 12 / 60), 2)).epsilon(0.06));
}

TEST_CASE("shake: it lasts for some frames and is over then, and the number of frames may wrap") {
  Shake shake;
  std::uint32_t frame = 0xFFFFFFF0;
  shake.update(top_at(0), frame++);
  shake.update(top_at(0), frame++);
  CHECK(shake.update(top_at(2), frame++) == 2);
  CHECK(shake.update(top_at(2), frame++) == 2);
  for (std::uint32_t i = 1; i < Shake::kLastingFrames; ++i) CHECK(shake.update(top_at(2), frame++) == 2);
  CHECK(shake.update(top_at(2), frame++) == 2);
  CHECK(shake.update(top_at(2), frame++) == 0);
}

TEST_CASE("shake: ignores frames around dropped ones and unseen plates") {
  Shake shake;
  std::uint32_t frame = 1;
  shake.update(top_at(0), frame++);
  shake.update(top_at(0), frame++);
  CHECK(shake.update(top_at(5), ++frame) == 0);  // one is missing in between
  CHECK(shake.update(PlatePoses{}, ++frame) == 0);
  CHECK(shake.update(top_at(0), ++frame) == 0);
  PlatePoses unseen = top_at(5);
  unseen.seen[kTopPlate] = false;
  CHECK(shake.update(unseen, ++frame) == 0);
  CHECK(shake.update(top_at(0), ++frame) == 0);
}
