#include "firmware/loop/self_test.h"

#include <cmath>

#include "firmware/loop/hold.h"
#include "firmware/modbus/registers.h"
#include "firmware/touch/touch_stage.h"

namespace finsight {

namespace {

void check_near(const Model& model, std::size_t number, const char* what, std::size_t index, double found,
                double expected, double tolerance) {
  if (std::abs(found - expected) <= tolerance) return;  // false for NaN
  throw SelfTestError(model.file().path(),
                      "self-test case " + std::to_string(number) + ", " + what + " " + std::to_string(index),
                      std::to_string(found), std::to_string(expected) + " within " + std::to_string(tolerance));
}

// As numbers on a ring, like the counts of both signed and unsigned registers.
void check_register(const Model& model, std::size_t number, std::size_t address, std::uint16_t found,
                    std::uint16_t expected, int tolerance) {
  const int difference = static_cast<std::int16_t>(found - expected);
  check_near(model, number, "register", address, expected + difference, expected, tolerance);
}

void check_shape(const Model& model, std::size_t number, const char* what, std::span<const float> found,
                 std::span<const float> expected) {
  for (std::size_t i = 0; i < found.size(); ++i) {
    check_near(model, number, what, i, found[i], expected[number * found.size() + i], kSelfTestShapeTolerance_mm);
  }
}

// Bits and codes must be equal: one count more means something else. Float mirrors are compared as the integers beside
// them, because half a float is not a number of counts.
void check_registers(const Model& model, std::size_t number, const RegisterImage& found,
                     std::span<const std::uint16_t> expected) {
  for (const RegisterRow& row : kRegisterTable.measurements) {
    if (row.type == RegisterType::kFloat32) continue;
    for (int word = 0; word < words_of(row.type); ++word) {
      const auto address = static_cast<std::size_t>(row.address + word);
      check_register(model, number, address, found.words[address], expected[kMeasurementRegisters * number + address],
                     row.is_number() ? kSelfTestRegisterTolerance : 0);
    }
  }
}

}  // namespace

SelfTestAnswer answer_self_test(const Model& model, std::span<const float> numbers, const ShapeSettings& settings) {
  ShapeStage shape_stage(model, settings);
  TouchStage touch_stage(model);
  const PlatePoses poses = seen_poses(numbers);
  LoopState state;
  state.rated_deformation_mm = model.rated_deformation_mm;
  Hold hold;
  hold.poses(poses, 0, state.settings);
  const FingerShape shape = hold.shape(shape_stage.solve(poses));
  const Touch touch = hold.touch(touch_stage.locate(poses));

  SelfTestAnswer answer;
  answer.shape_mm.assign(shape.node_mm.begin(), shape.node_mm.end());
  for (int i = 0; i < 3; ++i) {
    answer.touch[static_cast<std::size_t>(i)] = touch.point_mm[i];
    answer.touch[static_cast<std::size_t>(3 + i)] = touch.contact_mm[i];
  }
  answer.touch[6] = touch.force_n;
  state.limits = next_threshold_state(state.limits, shape, touch, state.rated_deformation_mm, state.settings);
  encode_registers(poses, shape, touch, state, answer.registers);
  return answer;
}

void check_self_test(const Model& model, ShapeSettings::Tier tier) {
  using Tier = ShapeSettings::Tier;
  const SelfTestModel& expected = model.self_test;
  const bool by_contact = model.contact_map && chosen_tier(model, tier) == Tier::kContact;
  const ShapeSettings settings = by_contact ? ShapeSettings{.tier = Tier::kContact} : ShapeSettings{};
  for (std::size_t c = 0; c < static_cast<std::size_t>(expected.cases); ++c) {
    const SelfTestAnswer answer = answer_self_test(model, expected.poses.subspan(kPoseDims * c, kPoseDims), settings);
    check_shape(model, c, by_contact ? "contact shape coordinate" : "shape coordinate", answer.shape_mm,
                by_contact ? expected.contact_shape_mm : expected.shape_mm);
    for (std::size_t i = 0; i < answer.touch.size(); ++i) {
      check_near(model, c, "touch number", i, answer.touch[i], expected.touch[7 * c + i], kSelfTestTouchTolerance);
    }
    check_registers(model, c, answer.registers, by_contact ? expected.contact_registers : expected.registers);
  }
}

}  // namespace finsight
