// What the digital outputs say, from the status word that clients read.
#pragma once

#include <array>
#include <cstdint>
#include <utility>

#include "firmware/modbus/registers.h"
#include "firmware/ports/gpio.h"

namespace finsight {

/// `status` is register 0. With any fault the safe levels; else contact and overload follow their bits, and healthy
/// means ready. The light is as it is set either way: without it no fault of seeing would end.
OutputLevels output_levels(std::uint16_t status, bool light, const OutputLevels& safe);

/// The same over time: a level that changes is set once it has lasted for the de-bounce time. Safe levels never wait.
class OutputFilter {
 public:
  explicit OutputFilter(const OutputLevels& safe) : safe_(safe), shown_(safe) {}
  const OutputLevels& next(std::uint16_t status, const RuntimeSettings& settings, std::int64_t now_ns);

 private:
  OutputLevels safe_, shown_;
  std::array<std::int64_t, kOutputs> changing_since_ns_{};  ///< 0: is what is wanted
};

/// Rising edges of the trigger input.
class TriggerInput {
 public:
  bool rises(bool level) {
    const bool before = std::exchange(level_, level);
    return level && !before;
  }

 private:
  bool level_ = true;  ///< a line that is active at the start does not rise
};

}  // namespace finsight
