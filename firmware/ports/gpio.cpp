#include "firmware/ports/gpio.h"

#include "firmware/input_error.h"

namespace finsight {

OutputLevels safe_levels(const GpioSettings& settings) {
  OutputLevels levels{};
  for (int output = 0; output < kOutputs; ++output) {
    levels[output] = settings.lines[output] && settings.lines[output]->safe_active;
  }
  return levels;
}

#if !FINSIGHT_HAS_GPIOD
bool has_gpio() { return false; }

void check_gpio(const GpioSettings& settings) {
  throw InputError("gpio.chip",
                   "\"" + settings.chip + "\" needs libgpiod 2, which this build lacks (Debian 13 has it)");
}

std::unique_ptr<Gpio> open_gpio(const GpioSettings& settings) {
  check_gpio(settings);
  return nullptr;
}
#endif

}  // namespace finsight
