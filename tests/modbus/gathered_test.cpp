#include "firmware/modbus/gathered.h"

#include <doctest/doctest.h>

#include <array>
#include <vector>

#include "firmware/modbus/registers.h"

using namespace finsight;

namespace {

constexpr std::int64_t kNow_ns = 1'000'000'000'000;

PlatePoses seen() {
  PlatePoses poses;
  poses.seen = {true, true, true};
  poses.quality = Quality::kFresh;
  return poses;
}

FingerShape shape() {
  FingerShape shape;
  shape.front_rms_mm = 1.5F;
  shape.quality = Quality::kFresh;
  return shape;
}

/// A finger touched with this normal force (none: 0), whose frame is `age_ms` old.
RegisterImage finger(float force_n, float x_mm, float y_mm, int age_ms, LoopState state = {}) {
  Touch touch;
  if (force_n > 0) {
    touch.quality = Quality::kFresh;
    touch.point_mm = {x_mm, y_mm, 3};
    touch.radius_68_mm = 0.8F;
    touch.force_n = force_n;
    touch.force_sigma_n = 0.2F;
    touch.force_vector_n = {force_n, 0.1F, -0.2F};
    touch.force_vector_sigma_n = {0.3F, 0.1F, 0.1F};
  }
  state.heartbeat = 42;
  state.exposure_ns = kNow_ns - age_ms * kNsPerMs;
  state.rated_deformation_mm = 6;
  state.limits.contact = force_n > 0;
  RegisterImage image;
  encode_registers(seen(), shape(), touch, state, image);
  set_age(image, kNow_ns);
  return image;
}

struct Gathered {
  explicit Gathered(const std::vector<RegisterImage>& fingers) { write_gathered(fingers, words); }
  std::uint16_t at(int address) const { return words[static_cast<std::size_t>(address - kGatheredAddress)]; }
  int signed_at(int address) const { return static_cast<std::int16_t>(at(address)); }
  bool has(std::uint16_t bit) const { return at(address_of("gripper_state")) & bit; }
  std::array<std::uint16_t, kGatheredRegisters> words;
};

}  // namespace

TEST_CASE("gathered: every finger's words are those of its own block, and absent fingers have no values") {
  const std::vector<RegisterImage> fingers = {finger(2, 1, 60, 20), finger(3.5F, -2, 70, 8)};
  const Gathered block(fingers);
  CHECK(block.at(address_of("fingers")) == 2);
  for (std::size_t i = 0; i < 2; ++i) {
    const auto own = [&](int address) { return fingers[i].words[static_cast<std::size_t>(address)]; };
    const int shift = static_cast<int>(i) * kFingerStride;
    CHECK(block.at(address_of("finger_1_status") + shift) == own(address_of("status")));
    CHECK(block.at(address_of("finger_1_heartbeat") + shift) == 42);
    CHECK(block.at(address_of("finger_1_age") + shift) == own(address_of("age")));
    CHECK(block.at(address_of("finger_1_touch_y") + shift) == own(address_of("touch_y")));
    CHECK(block.at(address_of("finger_1_touch_uncertainty") + shift) == 80);
    CHECK(block.at(address_of("finger_1_force") + shift) == own(address_of("force")));
    CHECK(block.at(address_of("finger_1_level") + shift) == 250);
    CHECK(block.at(address_of("finger_1_force_normal_uncertainty") + shift) == 30);
    CHECK(block.signed_at(address_of("finger_1_force_along") + shift) == -20);
  }
  CHECK(block.at(address_of("finger_3_status")) == 0);
  CHECK(block.at(address_of("finger_3_force")) == 65535);
  CHECK(block.signed_at(address_of("finger_4_force_along")) == -32768);
}

TEST_CASE("gathered: sum, balance and centre of two touched fingers, and the age of the older one") {
  const Gathered block({finger(2, 1, 60, 20), finger(3.5F, -2, 70, 8)});
  CHECK(block.at(address_of("oldest_age")) == 200);
  CHECK(block.at(address_of("force_sum")) == 550);
  CHECK(block.signed_at(address_of("force_balance")) == -150);
  CHECK(block.at(address_of("force_balance_uncertainty")) == 42);  // sqrt(2) 0.3 N
  CHECK(block.signed_at(address_of("touch_centre_x")) == 150);     // (1 + 2) / 2: the other finger faces this one
  CHECK(block.signed_at(address_of("touch_centre_y")) == 6500);
  CHECK(block.has(bit_named("gripper_state", "all_touch_valid")));
  CHECK(block.has(bit_named("gripper_state", "all_contact")));
  CHECK(block.has(bit_named("gripper_state", "all_ready")));
  CHECK_FALSE(block.has(bit_named("gripper_state", "any_fault")));
}

TEST_CASE("gathered: a finger that works and is not touched counts as 0 N, one with a fault spoils the sum") {
  const Gathered one_side({finger(2, 1, 60, 20), finger(0, 0, 0, 8)});
  CHECK(one_side.at(address_of("force_sum")) == 200);
  CHECK(one_side.signed_at(address_of("force_balance")) == 200);
  CHECK(one_side.signed_at(address_of("touch_centre_x")) == 100);
  CHECK_FALSE(one_side.has(bit_named("gripper_state", "all_touch_valid")));
  CHECK(one_side.has(bit_named("gripper_state", "any_contact")));

  LoopState lost;
  lost.camera_fault = true;
  lost.fault = FaultCode::kCameraLost;
  const Gathered broken({finger(2, 1, 60, 20), finger(0, 0, 0, 8, lost)});
  CHECK(broken.at(address_of("force_sum")) == 65535);
  CHECK(broken.signed_at(address_of("force_balance")) == -32768);
  CHECK(broken.at(address_of("force_balance_uncertainty")) == 65535);
  CHECK(broken.at(address_of("finger_1_force")) == 200);
  CHECK(broken.at(address_of("finger_2_fault")) == value_named("fault", "camera_lost"));
  CHECK(broken.has(bit_named("gripper_state", "any_fault")));
  CHECK_FALSE(broken.has(bit_named("gripper_state", "all_ready")));

  const Gathered held({finger(2, 1, 60, 20), finger(3, 0, 0, 8, lost)});  // its last touch is still valid
  CHECK(held.at(address_of("finger_2_force")) == 300);
  CHECK(held.at(address_of("force_sum")) == 65535);
  CHECK(held.signed_at(address_of("force_balance")) == -32768);
}

TEST_CASE("gathered: where a finger does not tell its normal force, the balance takes its force") {
  RegisterImage side = finger(2, 1, 60, 20);
  side.words[static_cast<std::size_t>(address_of("force_normal"))] = 0x8000;
  side.words[static_cast<std::size_t>(address_of("force_normal_uncertainty"))] = 0xFFFF;
  const Gathered block({side, finger(3.5F, -2, 70, 8)});
  CHECK(block.signed_at(address_of("force_balance")) == -150);
  CHECK(block.at(address_of("force_balance_uncertainty")) == 36);  // of 0.2 and 0.3 N
}

TEST_CASE("gathered: before a finger's first result there is no oldest age, and no touch means no centre") {
  RegisterImage none = empty_block();
  set_age(none, kNow_ns);
  CHECK(Gathered({finger(2, 1, 60, 20), none}).at(address_of("oldest_age")) == 65535);
  CHECK(Gathered({none, finger(2, 1, 60, 20)}).at(address_of("oldest_age")) == 65535);
  const Gathered untouched({finger(0, 0, 0, 8), finger(0, 0, 0, 8)});
  CHECK(untouched.signed_at(address_of("touch_centre_x")) == -32768);
  CHECK(untouched.at(address_of("force_sum")) == 0);
}
