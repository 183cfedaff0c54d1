// The digital outputs: what they say follows the status word that clients read.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>

#include "firmware/modbus/registers.h"
#include "firmware/ports/gpio.h"

namespace finsight {

/// `status` is register 0. With any fault the safe levels; otherwise contact and overload follow their bits, and
/// healthy means ready. The light always follows its setting: without it a fault of seeing could never end.
OutputLevels output_levels(std::uint16_t status, bool light, const OutputLevels& safe);

/// The same over time: a level changes once the new one has lasted for the debounce time. Safe levels never wait.
class OutputFilter {
 public:
  explicit OutputFilter(const OutputLevels& safe) : safe_(safe), shown_(safe) {}
  const OutputLevels& next(std::uint16_t status, const RuntimeSettings& settings, std::int64_t now_ns);

 private:
  OutputLevels safe_, shown_;
  std::array<std::int64_t, kOutputs> changing_since_ns_{};  ///< 0: shows what is wanted
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

/// The lines of a finger, if it has any: at their safe levels until the first block, with faults, at the end of the
/// program, and when it crashes. At most one object per finger at a time, all made in one thread.
class DigitalOutputs {
 public:
  /// Waits for lines that cannot be opened, because at a start the chip may have no rights yet; then throws InputError
  /// like open_gpio().
  explicit DigitalOutputs(const std::optional<GpioSettings>& settings);
  DigitalOutputs(std::unique_ptr<Gpio> gpio, const OutputLevels& safe);
  ~DigitalOutputs();
  DigitalOutputs(const DigitalOutputs&) = delete;
  DigitalOutputs& operator=(const DigitalOutputs&) = delete;

  /// False: the chip refused.
  bool set(const RegisterImage& image, const RuntimeSettings& settings);
  bool trigger_rises() { return gpio_ && trigger_.rises(gpio_->trigger()); }

 private:
  OutputFilter filter_;
  TriggerInput trigger_;
  std::unique_ptr<Gpio> gpio_;
};

}  // namespace finsight
