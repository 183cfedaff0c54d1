// The frame loop where the zero changes, and where the camera is not where it was.
#include <doctest/doctest.h>

#include "firmware/loop/frame_loop.h"
#include "tests/loop/feeder.h"

using namespace finsight;
using namespace finsight::test;

TEST_CASE("loop: where the mount was measured, the rest is known without a zero") {
  const auto radius = [](bool rest_is_known, const std::optional<MountModel>& mount) {
    LoopSettings settings;
    settings.rest_is_known = rest_is_known;
    settings.mount = mount;
    return Feeder(std::nullopt, settings).step(touched()).words[8];
  };
  CHECK(radius(false, std::nullopt) > radius(true, std::nullopt));
  CHECK(radius(false, model().mount) == radius(true, std::nullopt));
}

TEST_CASE("loop: plates that stand displaced as one body mean a camera that was knocked, until the next zero") {
  const Lens camera = test::camera_640x480();
  Feeder feeder(camera);
  const Images images(camera, moved_as_one(Vec3f(1.2F, 0, 0)));
  for (int frame = 1; frame < MountCheck::kFrames; ++frame) REQUIRE(feeder.step(images.next()).words[1] == 0);
  CHECK(feeder.step(images.next()).words[1] == static_cast<int>(FaultCode::kCameraMoved));
  feeder.loop.zeroing().begin();
  for (int frame = 0; frame < Zeroing::kFrames; ++frame) feeder.step(images.next());
  CHECK(feeder.step(images.next()).words[1] == 0);
}

TEST_CASE("loop: what plates tell of touches counts for nothing while the camera is not where it was") {
  const Lens camera = test::camera_640x480();
  Feeder feeder(camera);
  const Images images(camera, moved_as_one(Vec3f(0, 0, 4)));
  for (int frame = 1; frame < MountCheck::kFrames; ++frame) {
    REQUIRE((feeder.step(images.next()).words[0] & (kTouchValid | kAnyFault)) == 0);
  }
  const RegisterImage& image = feeder.step(images.next());
  CHECK(image.words[1] == static_cast<int>(FaultCode::kCameraMoved));
  CHECK((image.words[0] & kTouchValid) == 0);
  CHECK(image.words[5] == kNoInt16);
  CHECK(image.words[9] == kNoUint16);
  CHECK((feeder.loop.step_without_frame(feeder.now_ns + kMs).words[0] & kTouchValid) == 0);
}

TEST_CASE("loop: an older touch does not come back when markers vanish after plates that moved as one body") {
  const Lens camera = test::camera_640x480();
  LoopSettings settings;
  settings.runtime[kAfterHold] = 1;
  Feeder feeder(camera, settings);
  const Images touching(camera, touched()), knocked(camera, moved_as_one(Vec3f(0, 0, 4)));
  REQUIRE((feeder.step(touching.next()).words[0] & kTouchValid) != 0);
  for (int frame = 0; frame < 5; ++frame) REQUIRE((feeder.step(knocked.next()).words[0] & kTouchValid) == 0);
  const std::vector<std::uint8_t> empty(static_cast<std::size_t>(camera.width_px) * camera.height_px, 128);
  for (int frame = 0; frame < 60; ++frame) {
    std::vector<std::uint8_t> grey = empty;
    grey[static_cast<std::size_t>(frame)] ^= 1;  // a sensor's noise
    const RegisterImage& image = feeder.step(test::frame_of(camera, grey));
    CHECK((image.words[0] & (kTouchValid | kContact)) == 0);
    CHECK(image.words[5] == kNoInt16);
  }
}

TEST_CASE("loop: a new zero ends what was measured from the old one: the shaken finger's wide radius") {
  Feeder feeder;
  ZeroPose zero{};
  for (PlateMotion& plate : zero) plate.displacement_mm = Vec3f(0, 0, 1);
  PlatePoses poses = touched();
  for (int frame = 0; frame < 4; ++frame) feeder.step(poses);
  const std::uint16_t calm = feeder.step(poses).words[8];
  // The zero moves every plate's place by 1 mm from one frame to the next, which is no shake.
  PlatePoses shifted = poses;
  for (PlateMotion& plate : shifted.plates) plate.displacement_mm.z() += 1;
  feeder.loop.zeroing().set_zero(zero);
  for (int frame = 0; frame < 3; ++frame) CHECK(feeder.step(shifted).words[8] == calm);
  // And a shake before the new zero is over with it.
  PlatePoses swung = shifted;
  swung.plates[kTopPlate].displacement_mm.z() += 3;
  feeder.step(swung);
  REQUIRE(feeder.step(shifted).words[8] > calm);
  zero[kTopPlate].displacement_mm.z() = 1.001F;
  feeder.loop.zeroing().set_zero(zero);
  CHECK(feeder.step(shifted).words[8] == doctest::Approx(calm).epsilon(0.02));
}

TEST_CASE("loop: a new zero does not glide in through the low-pass, nor does taking it away") {
  Feeder feeder(std::nullopt, {.shape = {.tier = ShapeSettings::Tier::kMap}, .runtime = {}, .smoothing_ms = 200});
  for (int frame = 0; frame < 10; ++frame) feeder.step(touched());
  const auto top_z = [&] { return static_cast<std::int16_t>(feeder.step(touched()).words[16]); };
  const int before = top_z();
  ZeroPose zero{};
  zero[kTopPlate].displacement_mm = Vec3f(0, 0, 1);
  feeder.loop.zeroing().set_zero(zero);
  Feeder unsmoothed;
  unsmoothed.loop.zeroing().set_zero(zero);
  const auto with_zero = static_cast<std::int16_t>(unsmoothed.step(touched()).words[16]);
  CHECK(with_zero == doctest::Approx(before - 100).epsilon(0.01));  // it also tells of a camera turned a little
  CHECK(top_z() == with_zero);
  feeder.loop.zeroing().set_zero(std::nullopt);  // factory settings
  CHECK(top_z() == before);
}

TEST_CASE("loop: what is held from the old zero is not shown with the new one") {
  Feeder feeder(std::nullopt, holding(1000));
  feeder.step(touched());
  REQUIRE((feeder.step_nothing_seen().words[0] & kTouchValid) != 0);
  feeder.loop.zeroing().set_zero(ZeroPose{});
  CHECK(touch_registers_are_invalid(feeder.step_nothing_seen()));
}

TEST_CASE("loop: a finger that is touched gets no zero, wherever the zero before is") {
  Feeder feeder;
  const PlatePoses rest = touched(-0.25F), pressed = touched(0.25F);  // 1.3 mm from the model's rest either way
  const auto zero = [&](const PlatePoses& poses) {
    feeder.loop.zeroing().begin();
    std::optional<bool> done;
    for (int frame = 0; frame < 100 && !done; ++frame) {
      feeder.step(poses);
      done = feeder.loop.zeroing().take_outcome();
    }
    return done;
  };
  CHECK(zero(rest) == true);
  REQUIRE((feeder.step(pressed).words[0] & kTouchValid) != 0);
  CHECK(zero(pressed) == false);
  CHECK((feeder.step(pressed).words[0] & kTouchValid) != 0);
  CHECK(zero(rest) == true);
}
