// Digital outputs and one input: lines of a GPIO chip, driven through libgpiod 2. An interface, because tests use a
// recording stand-in.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

namespace finsight {

enum Output : std::uint8_t { kContactOutput, kOverloadOutput, kHealthyOutput, kLightOutput };
inline constexpr int kOutputs = 4;
inline constexpr std::array<const char*, kOutputs> kOutputName = {"contact", "overload", "healthy", "light"};

/// One level per output; true: active (the line's `active_low` says which voltage that is).
using OutputLevels = std::array<bool, kOutputs>;

struct GpioLine {
  std::string name;  ///< as the chip names it; empty: by number
  unsigned number = 0;
  bool active_low = false;
};

struct OutputLine : GpioLine {
  bool safe_active = false;  ///< the level on a fault, before the first frame and at exit
};

struct GpioSettings {
  /// Path ("/dev/gpiochip0") or label ("pinctrl-bcm2711"); labels do not depend on the kernel's version.
  std::string chip;
  std::string consumer;  ///< what tools such as gpioinfo show as the lines' user
  std::array<std::optional<OutputLine>, kOutputs> lines;
  std::optional<GpioLine> trigger = std::nullopt;  ///< an input
};

OutputLevels safe_levels(const GpioSettings& settings);

class Gpio {
 public:
  /// Sets the safe levels and releases the lines.
  virtual ~Gpio() = default;
  /// All lines at once; levels of outputs that have no line are ignored. False: the chip refused. Never throws or
  /// allocates; may be called from a signal handler.
  virtual bool set(const OutputLevels& levels) = 0;
  /// The trigger input's level; false without one, or if the chip does not say.
  virtual bool trigger() = 0;
};

/// Requests the lines, at their safe levels. Throws InputError for a chip that does not exist (listing those that do),
/// a line that does not exist, is in use or named twice, and always in a build without libgpiod 2.
std::unique_ptr<Gpio> open_gpio(const GpioSettings& settings);

/// Throws InputError where open_gpio() would, but takes no line; those that a running finsightd has count as free.
void check_gpio(const GpioSettings& settings);

/// Whether this build has libgpiod 2.
bool has_gpio();

}  // namespace finsight
