#include "firmware/loop/frame_loop.h"

#include <doctest/doctest.h>

#include <bit>
#include <limits>

#include "tests/count_allocations.h"
#include "tests/loop/feeder.h"

using namespace finsight;
using namespace finsight::test;

TEST_CASE("loop: all that is told of a fitted finger is told of its changed motions") {
  LoopSettings settings;
  settings.fit.emplace();
  Feeder usual(std::nullopt, settings);
  settings.fit->motion_change.setIdentity();
  settings.fit->motion_change *= 0.25F;
  Feeder changed(std::nullopt, settings);
  usual.step(touched(1.25F));
  changed.step(touched());
  CHECK(plate_motion_mm(changed.loop.view().poses.plates) ==
        doctest::Approx(plate_motion_mm(usual.loop.view().poses.plates)));
  CHECK(changed.loop.registers().words[5] == usual.loop.registers().words[5]);
}

TEST_CASE("loop: where the settings want it, the last values stay held after the hold time, with the fault") {
  LoopSettings settings = holding(101);
  settings.runtime[kAfterHold] = 1;
  Feeder feeder(std::nullopt, settings);
  const RegisterImage seen = feeder.step(touched());
  RegisterImage held;
  for (int i = 0; i < 20; ++i) held = feeder.step_nothing_seen();
  CHECK(held.words[0] == (kReady | kTouchValid | kContact | kHeld | kAnyFault));
  CHECK(held.words[1] == static_cast<std::uint16_t>(FaultCode::kMarkersLost));
  CHECK(held.words[6] == seen.words[6]);
  settings.runtime[kAfterHold] = 0;
  feeder.loop.use(settings.runtime);
  CHECK(feeder.step_nothing_seen().words[0] == kAnyFault);
  CHECK(feeder.step(touched()).words[0] == seen.words[0]);
}

TEST_CASE("loop: recorded plates go through all stages into the registers") {
  Feeder feeder;
  const PlatePoses poses = touched();
  const RegisterImage image = feeder.step(poses);

  ShapeStage shape_stage(model(), ShapeSettings{});
  TouchStage touch_stage(model());
  RegisterImage expected;
  encode_registers(poses, shape_stage.solve(poses), touch_stage.locate(poses), feeder.loop.state(), expected);
  CHECK(image.words == expected.words);
  CHECK(image.exposure_ns == kStart + kPeriod);

  CHECK(image.words[0] == (kReady | kTouchValid | kContact | kShapeValid | kAllSeen));
  CHECK(image.words[1] == 0);
  CHECK(image.words[16] == std::lround(100 * poses.plates[kTopPlate].displacement_mm.z()));
  CHECK(feeder.step(poses).words[35] == 2);  // one factorisation, one chord step, once the start from the map is behind
  CHECK((std::uint32_t{image.words[36]} << 16 | image.words[37]) == model().checksum);
}

TEST_CASE("loop: its settings reach the solver and the registers") {
  LoopSettings settings{.shape = {.tier = ShapeSettings::Tier::kMap}, .runtime = {}};
  settings.runtime[kWordOrder] = 1;
  Feeder feeder(std::nullopt, settings);
  const RegisterImage& image = feeder.step(touched());
  CHECK(image.words[35] == 0);
  CHECK(image.words[43] == 1);  // the shape map
  CHECK((std::uint32_t{image.words[37]} << 16 | image.words[36]) == model().checksum);
}

TEST_CASE("loop: the contact tier shows its shape in the registers; over range the shape map's, and no touch") {
  Feeder feeder(std::nullopt, {.shape = {.tier = ShapeSettings::Tier::kContact}, .runtime = {}});
  const PlatePoses poses = touched(), far = touched(8);
  const RegisterImage touching = feeder.step(poses);
  ShapeStage contact(model(), {.tier = ShapeSettings::Tier::kContact}),
      map(model(), {.tier = ShapeSettings::Tier::kMap});
  const FingerShape& shape = contact.solve(poses);
  CHECK(touching.words[0] == (kReady | kTouchValid | kContact | kShapeValid | kAllSeen));
  CHECK(touching.words[43] == 3);
  CHECK(touching.words[11] == std::lround(1000 * shape.front_rms_mm / model().rated_deformation_mm));
  CHECK(touching.words[12] == std::lround(100 * shape.largest_mm));
  CHECK(touching.words[13] == std::lround(100 * shape.rms_mm));

  const RegisterImage& over = feeder.step(far);
  CHECK((over.words[0] & kOverRange) != 0);
  CHECK((over.words[0] & kTouchValid) == 0);
  CHECK(over.words[43] == 1);
  CHECK(over.words[12] == std::lround(100 * map.solve(far).largest_mm));
}

TEST_CASE("loop: with the top plate alone the others are completed, and the shape is not called valid") {
  Feeder feeder;
  PlatePoses poses = touched(), completed = poses;
  poses.seen = completed.seen = {true, false, false};
  poses.plates[kMiddlePlate] = poses.plates[kLowPlate] = {Vec3f(50, 50, 50), Vec3f(1, 1, 1)};  // must not be read
  complete_from_prior(model().prior, completed);
  const RegisterImage& image = feeder.step(poses);
  CHECK(image.words[0] == (kReady | kTouchValid | kContact | kTopSeen));
  CHECK(image.words[1] == 0);
  ShapeStage stage(model(), ShapeSettings{});
  CHECK(image.words[12] == std::lround(100 * stage.solve(completed).largest_mm));
}

TEST_CASE("loop: lost markers are held for the hold time, then everything is invalid, then it comes back") {
  Feeder feeder(std::nullopt, holding(101));
  const RegisterImage seen = feeder.step(touched());
  for (int frame = 1; frame <= 6; ++frame) {
    const RegisterImage& held = feeder.step_nothing_seen();
    CAPTURE(frame);
    CHECK(held.words[0] == (kReady | kTouchValid | kContact | kHeld));
    CHECK(held.words[1] == 0);
    for (const std::size_t address : {5, 6, 7, 9, 14, 15, 16, 40}) CHECK(held.words[address] == seen.words[address]);
  }
  for (int frame = 0; frame < 3; ++frame) {
    const RegisterImage& lost = feeder.step_nothing_seen();
    CHECK(lost.words[0] == kAnyFault);
    CHECK(lost.words[1] == static_cast<int>(FaultCode::kMarkersLost));
    CHECK(touch_registers_are_invalid(lost));
  }
  const RegisterImage& back = feeder.step(touched());
  CHECK(back.words[0] == seen.words[0]);
  CHECK(back.words[1] == 0);
  CHECK(std::equal(&back.words[5], &back.words[32], &seen.words[5]));
}

TEST_CASE("loop: a hold time of zero holds nothing") {
  Feeder feeder(std::nullopt, holding(0));
  feeder.step(touched());
  CHECK(touch_registers_are_invalid(feeder.step_nothing_seen()));
}

TEST_CASE("loop: a lost camera is a fault at once, its last result is held for the hold time") {
  Feeder feeder(std::nullopt, holding(100));
  const RegisterImage seen = feeder.step(touched());
  const RegisterImage held = feeder.loop.step_without_frame(feeder.now_ns + 100 * kMs);
  CHECK(held.words[0] == (kReady | kTouchValid | kContact | kHeld | kCameraFault | kAnyFault));
  CHECK(held.words[1] == static_cast<int>(FaultCode::kCameraLost));
  CHECK(held.words[2] == seen.words[2] + 1);
  CHECK(held.words[5] == seen.words[5]);
  CHECK(held.exposure_ns == seen.exposure_ns);  // the age goes on counting from the last exposure
  CHECK(std::equal(&held.words[32], &held.words[35], &seen.words[32]));  // no frame was counted

  const RegisterImage& lost = feeder.loop.step_without_frame(feeder.now_ns + 100 * kMs + 1);
  CHECK(lost.words[0] == (kCameraFault | kAnyFault));
  CHECK(lost.words[1] == static_cast<int>(FaultCode::kCameraLost));
  CHECK(touch_registers_are_invalid(lost));

  const RegisterImage& back = feeder.step(touched());
  CHECK(back.words[0] == seen.words[0]);
  CHECK(back.words[1] == 0);
}

TEST_CASE("loop: a camera that never delivers gives invalid values and no age") {
  Feeder feeder;
  for (int i = 0; i < 3; ++i) {
    const RegisterImage& image = feeder.loop.step_without_frame(kStart + i * 100 * kMs);
    CHECK(image.words[0] == (kCameraFault | kAnyFault));
    CHECK(touch_registers_are_invalid(image));
    CHECK(image.words[4] == kNoUint16);
    CHECK(image.exposure_ns == 0);
  }
}

TEST_CASE("loop: poses that no finger can have keep the last shape, with the solver's fault") {
  Feeder feeder;
  const RegisterImage seen = feeder.step(touched());
  PlatePoses bad = touched();
  bad.plates[kLowPlate].rotation_rad.x() = std::numeric_limits<float>::quiet_NaN();
  const RegisterImage& image = feeder.step(bad);
  CHECK((image.words[0] & (kSolverFallback | kAnyFault | kTouchValid | kHeld)) ==
        (kSolverFallback | kAnyFault | kHeld));
  CHECK(image.words[1] == static_cast<int>(FaultCode::kSolverFailed));
  CHECK(image.words[11] == seen.words[11]);
  CHECK(feeder.step(touched()).words[0] == seen.words[0]);
}

TEST_CASE("loop: counts results, frames and gaps in the camera's counter") {
  Feeder feeder;
  feeder.sequence = 1000;  // the camera ran before us
  const auto dropped = [&] { return feeder.step(touched()).words[34]; };
  CHECK(dropped() == 0);
  CHECK(dropped() == 0);
  feeder.sequence += 3;
  const RegisterImage image = feeder.step(touched());
  CHECK(image.words[2] == 3);      // heartbeat
  CHECK(image.words[33] == 1005);  // frame counter
  CHECK(image.words[34] == 3);
  CHECK(feeder.loop.state().frames == 3);
  CHECK(feeder.loop.times().frame.count() == 3);
  CHECK(feeder.loop.times().table().find("registers       3 ") != std::string::npos);
}

TEST_CASE("loop: the camera's counter may wrap, and may start again") {
  Feeder feeder;
  feeder.sequence = 0xFFFF'FFFF;
  feeder.step(touched());
  CHECK(feeder.step(touched()).words[34] == 0);  // 0 comes after 2^32 - 1
  feeder.sequence += 2;
  CHECK(feeder.step(touched()).words[34] == 2);
  feeder.sequence = 0;  // the camera was restarted: how many frames that cost is not known
  CHECK(feeder.step(touched()).words[34] == 2);
  CHECK(feeder.step(touched()).words[34] == 2);
}

TEST_CASE("loop: images give the same registers as the poses that they show, within what pixels can tell") {
  const Lens camera = test::camera_1280x720();
  Feeder seeing(camera), knowing;
  const std::vector<std::uint8_t> grey = painted(camera, touched(), 1);
  const RegisterImage& seen = seeing.step(test::frame_of(camera, grey));
  const RegisterImage& known = knowing.step(touched());
  CHECK(seen.words[0] == known.words[0]);
  for (std::size_t address = 14; address < 17; ++address) {  // the top plate's displacement
    CHECK(std::abs(static_cast<std::int16_t>(seen.words[address]) - static_cast<std::int16_t>(known.words[address])) <
          20);
  }
  // Recorded poses win over the camera: such a frame has no image.
  CHECK(seeing.step(touched(1.1f)).words[16] == knowing.step(touched(1.1f)).words[16]);

  const std::vector<std::uint8_t> dark(grey.size(), 20);
  const RegisterImage& held = seeing.step(test::frame_of(camera, dark));
  CHECK((held.words[0] & (kHeld | kTopSeen)) == kHeld);
}

TEST_CASE("loop: a frozen camera is a fault, and its image is never shown as fresh") {
  const Lens camera = test::camera_640x480();
  Feeder feeder(camera);
  const std::vector<std::uint8_t> grey = painted(camera, touched(), 1), other = painted(camera, touched(), 2);
  CHECK((feeder.step(test::frame_of(camera, grey)).words[0] & (kTouchValid | kHeld)) == kTouchValid);
  for (int frame = 1; frame < 5; ++frame) {
    const std::uint16_t repeated = feeder.step(test::frame_of(camera, grey)).words[0];
    CHECK((repeated & (kTouchValid | kHeld | kCameraFault)) == (kTouchValid | kHeld));
  }
  const std::uint16_t frozen = feeder.step(test::frame_of(camera, grey)).words[0];
  CHECK((frozen & (kCameraFault | kAnyFault | kHeld)) == (kCameraFault | kAnyFault | kHeld));
  CHECK(feeder.loop.state().fault == FaultCode::kCameraFrozen);
  for (int frame = 0; frame < 30; ++frame) feeder.step(test::frame_of(camera, grey));
  const RegisterImage& over = feeder.step(test::frame_of(camera, grey));
  CHECK((over.words[0] & (kTouchValid | kHeld)) == 0);
  CHECK(over.words[1] == 9);
  CHECK(feeder.step(test::frame_of(camera, other)).words[1] == 0);
}

TEST_CASE("loop: without light the fault says so once nothing is held any more") {
  const Lens camera = test::camera_640x480();
  Feeder feeder(camera);
  feeder.step(test::frame_of(camera, painted(camera, touched(), 1)));
  std::vector<std::uint8_t> grey(static_cast<std::size_t>(camera.width_px) * camera.height_px);
  for (const std::pair<int, int>& light : {std::pair{1, 10}, {254, 11}, {100, 2}}) {
    CAPTURE(light.first);
    for (int frame = 0; frame < 40; ++frame) {
      std::fill(grey.begin(), grey.end(), static_cast<std::uint8_t>(light.first));
      grey[static_cast<std::size_t>(frame)] ^= 1;  // a sensor's noise
      feeder.step(test::frame_of(camera, grey));
    }
    CHECK(feeder.loop.state().fault == static_cast<FaultCode>(light.second));
  }
}

TEST_CASE("loop: frames with recorded poses allocate nothing, whatever happens, from the first one on") {
  PlatePoses alone = touched(), bad = touched(), far = touched(4), swapped = touched();
  alone.seen = {true, false, false};
  bad.plates[0].displacement_mm.x() = std::numeric_limits<float>::infinity();
  swapped.plates[kTopPlate].displacement_mm.y() = -80;
  swapped.plates[kLowPlate].displacement_mm.y() = 80;
  const PlatePoses nothing, all[] = {touched(), alone, far, bad, swapped, nothing, touched(-1)};
  using Tier = ShapeSettings::Tier;
  for (const Tier tier : {Tier::kMeasures, Tier::kMap, Tier::kContact, Tier::kMapAndNewton, Tier::kNewton}) {
    Feeder feeder(std::nullopt, {.shape = {.tier = tier}, .runtime = {}});
    const long before = test::allocations;
    for (int round = 0; round < 3; ++round) {
      for (const PlatePoses& poses : all) feeder.step(poses);
      feeder.loop.step_without_frame(feeder.now_ns + 1000 * kMs);
    }
    const long after = test::allocations;
    CHECK(after == before);
  }
}

// OpenCV's detector allocates in every window that it looks at, as any user of it must accept. All else does not.
TEST_CASE("loop: images allocate what the marker detector does, and not once more") {
  const Lens camera = test::camera_640x480();
  const std::vector<std::uint8_t> bent = painted(camera, touched(), 1), further = painted(camera, touched(1.1f), 2),
                                  dark(bent.size(), 20);
  const std::vector<std::uint8_t>* shown[] = {&bent, &further, &bent, &dark, &dark, &bent, &further};
  Feeder feeder(camera);
  MarkerStage markers(model(), camera);
  int found = 0;
  std::uint8_t number = 0;
  for (int round = 0; round < 3; ++round) {
    for (const auto* grey : shown) {
      std::vector<std::uint8_t> pixels = *grey;
      pixels[0] = ++number;  // none repeats one before it
      const Frame frame = test::frame_of(camera, pixels);
      const long start = test::allocations;
      const bool seen = markers.find(frame).seen[kTopPlate];
      const long detector = test::allocations - start;
      const RegisterImage& image = feeder.step(frame);
      const long loop = test::allocations - start - detector;
      CHECK(seen == ((image.words[0] & kTopSeen) != 0));
      CHECK(detector > 0);
      if (round > 0) CHECK(loop == detector);
      found += seen;
    }
  }
  CHECK(found > 9);
}
