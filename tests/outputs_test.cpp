#include <doctest/doctest.h>

#include "firmware/modbus/registers.h"
#include "firmware/outputs.h"

using namespace finsight;

namespace {
constexpr OutputLevels kSafe = {true, true, false};
}

TEST_CASE("outputs: without a fault every line follows its bit of the status word") {
  CHECK(output_levels(0, kSafe) == OutputLevels{false, false, false});
  CHECK(output_levels(kReady, kSafe) == OutputLevels{false, false, true});
  CHECK(output_levels(kReady | kContact, kSafe) == OutputLevels{true, false, true});
  CHECK(output_levels(kReady | kOverRange, kSafe) == OutputLevels{false, true, true});
}

TEST_CASE("outputs: with any fault the lines are safe, whatever else the status word says") {
  for (const unsigned others : {0U, 0x7fffU, unsigned{kReady}, unsigned{kReady | kContact}}) {
    CHECK(output_levels(static_cast<std::uint16_t>(kAnyFault | others), kSafe) == kSafe);
  }
}

TEST_CASE("outputs: the safe levels are the settings', and an output without a line has none") {
  GpioSettings settings;
  CHECK(safe_levels(settings) == OutputLevels{false, false, false});
  settings.lines[kOverloadOutput] = OutputLine{};
  settings.lines[kOverloadOutput]->safe_active = true;
  CHECK(safe_levels(settings) == OutputLevels{false, true, false});
}
