#include "firmware/modbus/registers.h"

#include <doctest/doctest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

using namespace finsight;

namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInf = std::numeric_limits<float>::infinity();

struct Scene {
  PlatePoses poses;
  FingerShape shape;
  Touch touch;
  LoopState state;

  RegisterImage encoded() const {
    RegisterImage image;
    image.words.fill(0xDEAD);  // so that a word that is not written is noticed
    encode_registers(poses, shape, touch, state, image);
    return image;
  }
  std::uint16_t word(std::size_t address) const { return encoded().words[address]; }
};

/// A touched finger of which all values differ.
Scene touched_finger() {
  Scene s;
  s.poses.plates[kTopPlate] = {{1.5F, -0.25F, 12.0F}, {0.1F, -0.2F, 0.01F}};
  s.poses.seen = {true, true, true};
  s.poses.quality = Quality::kFresh;
  s.shape = {{}, 3.25F, 14.5F, 6.75F, 4, ShapeSource::kNewton, false, Quality::kFresh};
  s.touch = {.point_mm = {1.5F, -2.25F, 0.5F},
             .contact_mm = {2.5F, 60.0F, 7.126F},
             .radius_68_mm = 0.8F,
             .force_n = 3.5F,
             .force_sigma_n = 0.11F,
             .force_vector_n = {3.5F, -1.25F, 0.75F},
             .force_vector_sigma_n = {0.11F, 0.22F, 0.33F},
             .wrench_force_n = {-1.25F, -0.5F, 3.25F},
             .wrench_force_sigma_n = {0.22F, 0.3F, 0.15F},
             .moment_nm = {0.25F, -0.125F, 0.064F},
             .moment_sigma_nm = {0.031F, 0.012F, 0.008F},
             .plate_motion_mm = 12.0F,
             .over_range = false,
             .quality = Quality::kFresh};
  s.state.heartbeat = 65535;
  s.state.frames = 7;
  s.state.frame_counter = 0x00012345;
  s.state.dropped_frames = 17;
  s.state.exposure_ns = 5'000'000'000;
  s.state.published_ns = 5'012'340'000;
  s.state.model_checksum = 0xCAFEBABE;
  s.state.rated_deformation_mm = 6.5F;
  s.state.scene = scene_code("grasp");
  s.state.force_scale = 1.1F;
  s.state.force_scale_sigma = 0.03F;
  s.state.fitted_on = 9823;
  s.state.today = 9835;
  s.state.settings[kVerifiedOn] = 9830;
  s.state.limits = {.contact = true, .gentle = true};
  return s;
}

}  // namespace

TEST_CASE("registers: a touched finger encodes to words worked out by hand") {
  // 0.1 rad = 5.7296 deg, -0.2 rad = -11.4592 deg, 0.01 rad = 0.5730 deg; 3.25 of 6.5 mm = 500 permille.
  const std::vector<std::uint16_t> expected = {
      0x00EF, 0,      65535,  0,      123,         //  0: status ... latency 12.34 ms
      150,    0xFF1F, 50,     80,     350,    11,  //  5: touch -2.25 mm = -225 = 0xFF1F
      500,    1450,   675,                         // 11: level, displacements
      150,    0xFFE7, 1200,   573,    0xFB86, 57,  // 14: top plate, -25, -1146 = 0xFB86
      0x3FC0, 0x0000, 0xC010, 0x0000, 0x3F00, 0x0000, 0x4060, 0x0000, 0x4050, 0x0000, 0x7FC0, 0x0000,  // 20: floats
      0x0001, 0x2345, 17,     4,      0xCAFE, 0xBABE, 3,      0x1234,  // 32: counters and constants
      250,    6000,   713,    2,      3,      0,      0x1234, 0x5678,  // 40: contact, shape source, limits, test
      350,    0xFF83, 75,     11,     22,     33,                      // 48: force vector and deviations
      0xFF83, 0xFFCE, 325,    250,    0xFF83, 64,                      // 54: wrench
      22,     30,     15,     31,     12,     8,                       // 60: its deviations
      0x4060, 0x0000, 0xBFA0, 0x0000, 0x3F40, 0x0000,                  // 66: force vector as floats
      0x3E80, 0x0000, 0xBE00, 0x0000, 0x3D83, 0x126F,                  // 72: moment as floats
      0,      0,      2,                                               // 78: reserved, scene
      1100,   30,     9823,   5};                                      // 81: force scale, fitted, verified
  const RegisterImage image = touched_finger().encoded();
  CHECK(std::vector<std::uint16_t>(image.words.begin(), image.words.end()) == expected);
  CHECK(image.exposure_ns == 5'000'000'000);
}

TEST_CASE("registers: word order CDAB swaps the words of every 32-bit register and nothing else") {
  Scene scene = touched_finger();
  const RegisterImage big = scene.encoded();
  scene.state.settings[kWordOrder] = 1;
  const RegisterImage swapped = scene.encoded();
  const std::vector<std::size_t> pairs = {20, 22, 24, 26, 28, 30, 32, 36, 46, 66, 68, 70, 72, 74, 76};
  std::vector<std::uint16_t> expected(big.words.begin(), big.words.end());
  for (const std::size_t first : pairs) std::swap(expected[first], expected[first + 1]);
  CHECK(std::vector<std::uint16_t>(swapped.words.begin(), swapped.words.end()) == expected);
  CHECK(swapped.words[20] == 0x0000);
  CHECK(swapped.words[21] == 0x3FC0);
}

TEST_CASE("registers: before the first result the device is not ready and no value is valid") {
  const RegisterImage image = Scene{}.encoded();
  for (const std::size_t a : {0U, 1U, 2U, 3U, 32U, 33U, 34U, 35U, 36U, 37U, 43U, 44U, 45U}) {
    CHECK_MESSAGE(image.words[a] == 0, "register " << a);
  }
  for (const std::size_t a : {4U, 8U, 9U, 10U, 11U, 12U, 13U}) CHECK_MESSAGE(image.words[a] == 65535, "register " << a);
  for (const std::size_t a : {5U, 6U, 7U, 14U, 15U, 16U, 17U, 18U, 19U, 40U, 41U, 42U}) {
    CHECK_MESSAGE(image.words[a] == 0x8000, "register " << a);
  }
  for (std::size_t a = 20; a < 32; a += 2) {
    CHECK_MESSAGE(image.words[a] == 0x7FC0, "register " << a);
    CHECK_MESSAGE(image.words[a + 1] == 0, "register " << a + 1);
  }
  CHECK(image.words[39] == 0x1234);
}

TEST_CASE("registers: values out of range saturate just short of the invalid value") {
  Scene scene = touched_finger();
  scene.touch.point_mm = {400.0F, -400.0F, 327.67F};
  scene.touch.contact_mm = {-327.68F, 1e30F, -1e30F};
  scene.touch.radius_68_mm = 1e9F;
  scene.touch.force_n = 655.36F;
  scene.touch.force_sigma_n = -1.0F;
  scene.shape.front_rms_mm = 1e20F;
  scene.shape.largest_mm = 655.35F;
  scene.shape.rms_mm = -0.5F;
  scene.shape.iterations = 70000;
  scene.state.dropped_frames = 65536;
  scene.state.published_ns = scene.state.exposure_ns + 7'000'000'000;
  const RegisterImage image = scene.encoded();
  CHECK(image.words[5] == 0x7FFF);
  CHECK(image.words[6] == 0x8001);
  CHECK(image.words[7] == 0x7FFF);
  CHECK(image.words[40] == 0x8001);
  CHECK(image.words[41] == 0x7FFF);
  CHECK(image.words[42] == 0x8001);
  for (const std::size_t a : {4U, 8U, 9U, 11U, 12U}) CHECK_MESSAGE(image.words[a] == 65534, "register " << a);
  CHECK(image.words[10] == 0);
  CHECK(image.words[13] == 0);
  CHECK(image.words[34] == 65535);
  CHECK(image.words[35] == 65535);
}

TEST_CASE("registers: a latency that would be negative is 0") {
  Scene scene = touched_finger();
  scene.state.published_ns = scene.state.exposure_ns - 1'000'000;
  CHECK(scene.word(4) == 0);
}

TEST_CASE("registers: a value that is not finite is never published, nor is its status bit set") {
  for (const float bad : {kNan, -kNan, kInf, -kInf}) {
    Scene scene = touched_finger();
    scene.touch.force_n = bad;
    CHECK((scene.word(0) & kTouchValid) == 0);
    CHECK_FALSE(next_threshold_state({true, true, true}, scene.shape, scene.touch, 6.5F, {}).contact);
    CHECK(scene.word(5) == 0x8000);
    CHECK(scene.word(9) == 65535);
    CHECK(scene.word(26) == 0x7FC0);
    CHECK(scene.word(27) == 0);
    CHECK(scene.word(40) == 0x8000);

    scene = touched_finger();
    scene.touch.contact_mm.y() = bad;
    CHECK((scene.word(0) & kTouchValid) == 0);
    CHECK(scene.word(20) == 0x7FC0);

    scene = touched_finger();
    scene.touch.radius_68_mm = bad;  // the position is valid without its uncertainty
    CHECK((scene.word(0) & kTouchValid) != 0);
    CHECK(scene.word(5) == 150);
    CHECK(scene.word(8) == 65535);

    scene = touched_finger();
    scene.shape.largest_mm = bad;
    CHECK((scene.word(0) & kShapeValid) == 0);
    CHECK(scene.word(11) == 65535);
    CHECK(scene.word(28) == 0x7FC0);

    scene = touched_finger();
    scene.poses.plates[kTopPlate].rotation_rad.x() = bad;
    CHECK(scene.word(14) == 150);
    CHECK(scene.word(17) == 0x8000);
  }
}

TEST_CASE("registers: without a positive rated deformation there is no deformation level") {
  Scene scene = touched_finger();
  for (const float rated : {0.0F, -1.0F, kNan}) {
    scene.state.rated_deformation_mm = rated;
    CHECK(scene.word(11) == 65535);
  }
}

TEST_CASE("registers: each status bit follows its own cause") {
  const std::uint16_t all_well = kReady | kTouchValid | kContact | kShapeValid | kTopSeen | kMiddleSeen | kLowSeen;
  CHECK(touched_finger().word(0) == all_well);

  const auto status = [](auto change) {
    Scene scene = touched_finger();
    change(scene);
    return scene.word(0);
  };
  CHECK(status([](Scene& s) { s.touch.quality = Quality::kInvalid; }) == (all_well & ~kTouchValid));
  CHECK(status([](Scene& s) { s.touch.over_range = true; }) == (all_well | kOverRange));
  CHECK(status([](Scene& s) { s.touch.unexplained = true; }) == (all_well | kUnexplained));
  CHECK(status([](Scene& s) { s.state.limits.contact = false; }) == (all_well & ~kContact));
  CHECK(status([](Scene& s) { s.state.limits.overload = true; }) == (all_well | kOverload));
  CHECK(status([](Scene& s) { s.state.zeroed = true; }) == (all_well | kZeroed));
  CHECK(status([](Scene& s) { s.state.settings_unsaved = true; }) == (all_well | kSettingsUnsaved));
  CHECK(status([](Scene& s) { s.shape.quality = Quality::kInvalid; }) == (all_well & ~kShapeValid));
  CHECK(status([](Scene& s) { s.poses.seen[kTopPlate] = false; }) == (all_well & ~(kShapeValid | kTopSeen)));
  CHECK(status([](Scene& s) { s.poses.seen[kMiddlePlate] = false; }) == (all_well & ~(kShapeValid | kMiddleSeen)));
  CHECK(status([](Scene& s) { s.poses.seen[kLowPlate] = false; }) == (all_well & ~(kShapeValid | kLowSeen)));
  CHECK(status([](Scene& s) { s.poses.quality = Quality::kHeld; }) == (all_well | kHeld));
  CHECK(status([](Scene& s) { s.shape.quality = Quality::kHeld; }) == (all_well | kHeld));
  CHECK(status([](Scene& s) { s.touch.quality = Quality::kHeld; }) == (all_well | kHeld));
  CHECK(status([](Scene& s) { s.shape.fallback = true; }) == (all_well | kSolverFallback));
  CHECK(status([](Scene& s) { s.state.camera_fault = true; }) == (all_well | kCameraFault | kAnyFault));
  CHECK(status([](Scene& s) { s.state.fault = FaultCode::kMarkersLost; }) == (all_well | kAnyFault));
  CHECK(status([](Scene& s) { s.state.fault = FaultCode::kSelfTest; }) == ((all_well | kAnyFault) & ~kReady));
  CHECK(status([](Scene& s) { s.touch.quality = s.shape.quality = Quality::kInvalid; }) ==
        (kContact | kTopSeen | kMiddleSeen | kLowSeen));
}

TEST_CASE("registers: fault and shape source have the numbers of the register table") {
  Scene scene = touched_finger();
  scene.state.fault = FaultCode::kSolverFailed;
  scene.shape.source = ShapeSource::kMap;
  CHECK(scene.word(1) == 3);
  CHECK(scene.word(43) == 1);
}

TEST_CASE("registers: the age is the time from the exposure to the read") {
  RegisterImage image = touched_finger().encoded();
  const auto age = [&image](std::int64_t now_ns) {
    set_age(image, now_ns);
    return image.words[3];
  };
  CHECK(age(5'000'000'000 + 1'660'000) == 17);  // 1.66 ms, rounded
  CHECK(age(5'000'000'000 + 16'600'000) == 166);
  CHECK(age(5'000'000'000) == 0);
  CHECK(age(4'000'000'000) == 0);
  CHECK(age(60'000'000'000) == 65534);
  CHECK(age(std::numeric_limits<std::int64_t>::max()) == 65534);
  CHECK(image.words[2] == 65535);  // its neighbours are not changed
  CHECK(image.words[4] == 123);
  RegisterImage never = Scene{}.encoded();
  set_age(never, 5'000'000'000);
  CHECK(never.words[3] == 65535);
}

TEST_CASE("registers: a finger that was not verified in time is a warning, where that is asked for") {
  const auto warnings = [](std::uint16_t on, std::uint16_t verdict, std::uint16_t every, std::uint16_t today) {
    Scene s = touched_finger();
    s.state.warnings = kCameraSlow;
    s.state.today = today;
    s.state.settings[kVerifiedOn] = on;
    s.state.settings[kVerdict] = verdict;
    s.state.settings[kVerifyEvery] = every;
    return s.encoded().words[address_of("warnings")];
  };
  constexpr std::uint16_t kPassed = 1, kFailed = 2;
  CHECK(warnings(0, 0, 0, 9000) == kCameraSlow);
  CHECK(warnings(0, 0, 30, 9000) == (kCameraSlow | kNotVerified));
  CHECK(warnings(8990, kPassed, 30, 9000) == kCameraSlow);
  CHECK(warnings(0, kPassed, 30, 9000) == (kCameraSlow | kNotVerified));  // passed, but nobody knows when
  CHECK(warnings(8990, kFailed, 30, 9000) == (kCameraSlow | kNotVerified));
  CHECK(warnings(8900, kPassed, 30, 9000) == (kCameraSlow | kNotVerified));
  CHECK(warnings(8990, kPassed, 30, 100) == kCameraSlow);  // a board whose clock was never set
}

TEST_CASE("registers: the days since a verification are told only by a device that knows the day") {
  Scene s = touched_finger();
  s.state.today = 100;
  CHECK(s.encoded().words[address_of("verified_days_ago")] == 0xFFFF);
  s.state.fitted_on = 0;
  CHECK(s.encoded().words[address_of("fitted_on")] == 0xFFFF);
}
