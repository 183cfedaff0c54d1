#include "firmware/modbus/gathered.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "firmware/modbus/block_writer.h"
#include "firmware/modbus/registers.h"

namespace finsight {

namespace {

/// Which words of a finger's own block its part of this one repeats, in the order of its rows.
constexpr std::array kRepeated = {
    address_of("status"),
    address_of("fault"),
    address_of("heartbeat"),
    address_of("age"),
    address_of("touch_x"),
    address_of("touch_y"),
    address_of("touch_z"),
    address_of("touch_uncertainty"),
    address_of("force"),
    address_of("force_uncertainty"),
    address_of("deformation_level"),
    address_of("limits"),
    address_of("force_normal"),
    address_of("force_normal_uncertainty"),
    address_of("force_across"),
    address_of("force_along"),
};
static_assert(kRepeated.size() == kFingerStride);

/// How hard a finger is touched. One that works, sees all of its plates and tells no touch is touched too lightly.
struct Forces {
  double force_n = kNan, normal_n = kNan, normal_variance = kNan;
};

Forces forces_of(const RegisterImage& finger) {
  const std::uint16_t status = finger.words[0];
  if (status & kAnyFault) return {};  // also while the last touch is still held
  if (status & kTouchValid) {
    const double force_n = measured_value(finger, address_of("force"));
    const double normal_n = measured_value(finger, address_of("force_normal"));
    const double sigma_n = measured_value(finger, address_of("force_normal_uncertainty"));
    if (!std::isnan(normal_n) && !std::isnan(sigma_n)) return {force_n, normal_n, sigma_n * sigma_n};
    const double force_sigma_n = measured_value(finger, address_of("force_uncertainty"));
    return {force_n, force_n, force_sigma_n * force_sigma_n};  // the plates do not tell how the force is directed
  }
  const bool is_untouched = (status & kReady) && (status & kShapeValid) && !(status & (kOverRange | kUnexplained));
  return is_untouched ? Forces{0, 0, 0} : Forces{};
}

std::uint32_t state_of(std::span<const RegisterImage> fingers) {
  std::uint16_t all = 0xFFFF, any = 0;
  for (const RegisterImage& finger : fingers) {
    all &= finger.words[0];
    any |= finger.words[0];
  }
  std::uint32_t state = 0;
  if ((all & kReady) && !(any & kAnyFault)) state |= bit_named("gripper_state", "all_ready");
  if (all & kTouchValid) state |= bit_named("gripper_state", "all_touch_valid");
  if (any & kContact) state |= bit_named("gripper_state", "any_contact");
  if (all & kContact) state |= bit_named("gripper_state", "all_contact");
  if (any & (kOverload | kOverRange)) state |= bit_named("gripper_state", "any_overload");
  if (any & kHeld) state |= bit_named("gripper_state", "any_held");
  if (any & kAnyFault) state |= bit_named("gripper_state", "any_fault");
  return state;
}

/// What the fingers make together. Sums of what is not valid are NaN.
void write_gripper(std::span<const RegisterImage> fingers, BlockWriter& block) {
  double oldest_ms = 0, sum_n = 0, balance_n = 0, variance = 0;
  double x_mm = 0, y_mm = 0;
  int touches = 0;
  for (std::size_t i = 0; i < fingers.size(); ++i) {
    const RegisterImage& finger = fingers[i];
    const double side = i == 0 ? 1 : -1;
    const double age_ms = measured_value(finger, address_of("age"));
    if (!(age_ms <= oldest_ms)) oldest_ms = std::isnan(oldest_ms) ? kNan : age_ms;
    const Forces forces = forces_of(finger);
    sum_n += forces.force_n;
    balance_n += side * forces.normal_n;
    variance += forces.normal_variance;
    if (!(finger.words[0] & kTouchValid)) continue;
    x_mm += side * measured_value(finger, address_of("touch_x"));
    y_mm += measured_value(finger, address_of("touch_y"));
    ++touches;
  }
  block.count(row_named("fingers"), static_cast<std::uint32_t>(fingers.size()));
  block.count(row_named("gripper_state"), state_of(fingers));
  block.measured(row_named("oldest_age"), oldest_ms, true);
  block.measured(row_named("force_sum"), sum_n, true);
  block.measured(row_named("force_balance"), balance_n, true);
  block.measured(row_named("force_balance_uncertainty"), std::sqrt(variance), std::isfinite(balance_n));
  block.measured(row_named("touch_centre_x"), x_mm / touches, touches > 0);
  block.measured(row_named("touch_centre_y"), y_mm / touches, touches > 0);
}

}  // namespace

void write_gathered(std::span<const RegisterImage> fingers, std::span<std::uint16_t, kGatheredRegisters> words) {
  std::ranges::fill(words, std::uint16_t{0});
  BlockWriter block(words, kGatheredAddress, false);  // every register here is one word
  write_gripper(fingers, block);
  const RegisterRow* row = &row_named("finger_1_status");
  for (std::size_t finger = 0; finger < kMostFingers; ++finger) {
    for (const int repeated : kRepeated) {
      if (finger < fingers.size()) {
        words[static_cast<std::size_t>(row->address - kGatheredAddress)] =
            fingers[finger].words[static_cast<std::size_t>(repeated)];
      } else if (row->may_be_invalid()) {
        block.measured(*row, 0, false);
      }
      ++row;
    }
  }
}

}  // namespace finsight
