#include "firmware/loop/self_test.h"

#include <doctest/doctest.h>

#include <bit>

#include "firmware/input_error.h"
#include "firmware/modbus/registers.h"
#include "tests/model/tiny_model.h"

using namespace finsight;
using test::TinyModel;

namespace {

/// The model, with the firmware's answers as expected ones.
TinyModel with_answers(TinyModel tiny) {
  const Model model = tiny.open();
  for (std::size_t c = 0; c < TinyModel::kCases; ++c) {
    const SelfTestAnswer answer = answer_self_test(model, model.self_test.poses.subspan(kPoseDims * c, kPoseDims));
    std::copy(answer.shape_mm.begin(), answer.shape_mm.end(), &tiny.test_shape_mm[c * answer.shape_mm.size()]);
    std::copy(answer.touch.begin(), answer.touch.end(), &tiny.test_touch[7 * c]);
    std::copy(answer.registers.words.begin(), answer.registers.words.end(),
              &tiny.test_registers[kMeasurementRegisters * c]);
    if (!tiny.has_contact_map) continue;
    const SelfTestAnswer by_contact = answer_self_test(model, model.self_test.poses.subspan(kPoseDims * c, kPoseDims),
                                                       {.tier = ShapeSettings::Tier::kContact});
    std::copy(by_contact.shape_mm.begin(), by_contact.shape_mm.end(),
              &tiny.test_contact_shape_mm[c * by_contact.shape_mm.size()]);
    std::copy(by_contact.registers.words.begin(), by_contact.registers.words.end(),
              &tiny.test_contact_registers[kMeasurementRegisters * c]);
  }
  return tiny;
}

/// Case 0 nearly at rest, case 1 touched.
const TinyModel& good() {
  static const TinyModel tiny = [] {
    TinyModel model;
    for (std::size_t p = 0; p < kPlates; ++p)
      model.test_poses[kPoseDims + 6 * p + 2] = 15 - 3 * static_cast<float>(p);  // z, mm
    return with_answers(model);
  }();
  return tiny;
}

using Tier = ShapeSettings::Tier;

/// The self-test's message for this model, or "passed".
doctest::String verdict(const TinyModel& tiny, Tier tier = Tier::kNewton) {
  const Model model = tiny.open();
  try {
    check_self_test(model, tier);
  } catch (const SelfTestError& error) {
    return error.what();
  }
  return "passed";
}

constexpr std::size_t kTouched = kMeasurementRegisters;  // where the second case's registers begin
bool is_float_mirror(std::size_t address) {
  return measurement_row(static_cast<int>(address)).type == RegisterType::kFloat32;
}
/// Of bits and codes one more is something else, not rounding.
bool is_number(std::size_t address) { return measurement_row(static_cast<int>(address)).is_number(); }

}  // namespace

TEST_CASE("self-test: passes a pack that expects the firmware's answers; its touched case is a touch") {
  CHECK(verdict(good()) == "passed");
  CHECK((good().test_registers[0] & kTouchValid) == 0);
  CHECK((good().test_registers[kTouched] & (kReady | kTouchValid | kShapeValid)) ==
        (kReady | kTouchValid | kShapeValid));
  CHECK(good().test_registers[kTouched + 35] > 0);  // iterations of the solver
}

TEST_CASE("self-test: names a register that differs by two counts, and accepts one count") {
  for (std::size_t address = 0; address < kMeasurementRegisters; ++address) {
    if (is_float_mirror(address)) continue;
    CAPTURE(address);
    for (const int counts : {2, -2, 1, -1}) {
      TinyModel tiny = good();
      std::uint16_t& stored = tiny.test_registers[kTouched + address];
      stored = static_cast<std::uint16_t>(stored + counts);
      const bool refused = std::abs(counts) == 2 || !is_number(address);
      const std::string message = "self-test case 1, register " + std::to_string(address) + ": found";
      CHECK(verdict(tiny) == doctest::Contains(refused ? message.c_str() : "passed"));
    }
  }
}

TEST_CASE("self-test: one count across 32768 is one count in an unsigned register") {
  TinyModel tiny = good();
  const std::uint32_t bits =
      std::uint32_t{good().test_registers[kTouched + 28]} << 16 | good().test_registers[kTouched + 29];
  const float deformation_mm = std::bit_cast<float>(bits);
  tiny.parts.rated_deformation_mm = 1000 * deformation_mm / 32767.2f;  // a finger rated for next to nothing
  tiny = with_answers(tiny);
  REQUIRE(tiny.test_registers[kTouched + 11] == 32767);
  tiny.test_registers[kTouched + 11] = 32768;
  CHECK(verdict(tiny) == "passed");
}

TEST_CASE("self-test: names the coordinate or touch number that is off") {
  TinyModel shape = good(), touch = good();
  shape.test_shape_mm[10] += 2 * kSelfTestShapeTolerance_mm;
  CHECK(verdict(shape) == doctest::Contains("self-test case 0, shape coordinate 10: found"));
  touch.test_touch[7 + 6] += 2 * kSelfTestTouchTolerance;
  CHECK(verdict(touch) == doctest::Contains("self-test case 1, touch number 6: found"));
}

TEST_CASE("self-test: tests the contact map where its tier is to run, and the Newton steps where they are") {
  TinyModel shape = good(), registers = good(), newton = good(), without = good();
  REQUIRE(good().test_contact_registers[43] == static_cast<int>(ShapeSource::kContactMap));
  shape.test_contact_shape_mm[11] += 2 * kSelfTestShapeTolerance_mm;
  registers.test_contact_registers[43] = 1;
  newton.test_shape_mm[10] += 2 * kSelfTestShapeTolerance_mm;
  without.has_contact_map = false;
  for (const Tier tier : {Tier::kContact, Tier::kBest}) {
    CHECK(verdict(good(), tier) == "passed");
    CHECK(verdict(shape, tier) == doctest::Contains("self-test case 0, contact shape coordinate 11: found"));
    CHECK(verdict(registers, tier) == doctest::Contains("self-test case 0, register 43: found"));
    CHECK(verdict(newton, tier) == "passed");
  }
  CHECK(verdict(shape, Tier::kNewton) == "passed");
  CHECK(verdict(without, Tier::kBest) == "passed");
  without.test_shape_mm[10] += 2 * kSelfTestShapeTolerance_mm;
  CHECK(verdict(without, Tier::kBest) == doctest::Contains("self-test case 0, shape coordinate 10: found"));
}

TEST_CASE("self-test: refuses a changed network, whatever the tier") {
  TinyModel tiny = good();
  tiny.last_bias[1] += 0.1f;  // of touch y
  for (const Tier tier : {Tier::kNewton, Tier::kContact}) {
    CHECK(verdict(tiny, tier) == doctest::Contains("self-test case 1, touch number 1: found"));
  }
}
