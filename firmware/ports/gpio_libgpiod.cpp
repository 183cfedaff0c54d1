// The GPIO port on libgpiod 2's C interface: its C++ interface throws, which the frame loop must not.
#include <gpiod.h>

#include <cerrno>
#include <cstring>
#include <filesystem>

#include "firmware/input_error.h"
#include "firmware/ports/gpio.h"

namespace finsight {

namespace {

template <auto release>
struct Release {
  template <class T>
  void operator()(T* object) const {
    release(object);
  }
};
template <class T, auto release>
using Owned = std::unique_ptr<T, Release<release>>;
using Chip = Owned<gpiod_chip, gpiod_chip_close>;
using ChipInfo = Owned<gpiod_chip_info, gpiod_chip_info_free>;
using LineInfo = Owned<gpiod_line_info, gpiod_line_info_free>;
using LineSettings = Owned<gpiod_line_settings, gpiod_line_settings_free>;
using LineConfig = Owned<gpiod_line_config, gpiod_line_config_free>;
using RequestConfig = Owned<gpiod_request_config, gpiod_request_config_free>;
using LineRequest = Owned<gpiod_line_request, gpiod_line_request_release>;

std::string quoted(const std::string& text) { return "\"" + text + "\""; }

/// By path or by label. If there is none, the message lists the chips of this machine.
Chip open_chip(const std::string& wanted) {
  if (wanted.starts_with('/')) {
    Chip chip(gpiod_chip_open(wanted.c_str()));
    if (!chip) throw InputError("gpio.chip", quoted(wanted) + " cannot be opened: " + std::strerror(errno));
    return chip;
  }
  std::string found;
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator("/dev", ignored)) {
    const std::string path = entry.path().string();
    if (!path.starts_with("/dev/gpiochip")) continue;
    Chip chip(gpiod_chip_open(path.c_str()));
    const ChipInfo info(chip ? gpiod_chip_get_info(chip.get()) : nullptr);
    if (!info) {
      found += (found.empty() ? "" : ", ") + path + " (" + std::strerror(errno) + ")";
      continue;
    }
    const std::string label = gpiod_chip_info_get_label(info.get());
    if (label == wanted) return chip;
    found += (found.empty() ? "" : ", ") + path + " (" + quoted(label) + ")";
  }
  throw InputError("gpio.chip", found.empty() ? "no chip" : found, "a path or label", quoted(wanted));
}

/// The line's number on the chip; it must be free, or have this user.
unsigned find_line(gpiod_chip* chip, const GpioLine& line, const std::string& field, const char* allowed_user) {
  int offset = static_cast<int>(line.number);
  if (!line.name.empty()) {
    offset = gpiod_chip_get_line_offset_from_name(chip, line.name.c_str());
    if (offset < 0) throw InputError(field, "the chip has no line named " + quoted(line.name));
  }
  const std::string shown = line.name.empty() ? std::to_string(offset) : quoted(line.name);
  const LineInfo info(gpiod_chip_get_line_info(chip, static_cast<unsigned>(offset)));
  if (!info) throw InputError(field, "the chip has no line " + shown + " (" + std::strerror(errno) + ")");
  if (gpiod_line_info_is_used(info.get())) {
    const char* consumer = gpiod_line_info_get_consumer(info.get());
    if (consumer && allowed_user && std::strcmp(consumer, allowed_user) == 0) return static_cast<unsigned>(offset);
    throw InputError(field, "line " + shown + " is in use by " + quoted(consumer ? consumer : "the kernel"));
  }
  return static_cast<unsigned>(offset);
}

/// The numbers of all lines on the chip.
struct LineNumbers {
  LineNumbers(gpiod_chip* chip, const GpioSettings& settings, const char* allowed_user = nullptr) {
    for (int output = 0; output < kOutputs; ++output) {
      if (settings.lines[output])
        outputs[output] = find_unused(chip, *settings.lines[output], kOutputName[output], allowed_user);
    }
    if (settings.trigger) trigger = find_unused(chip, *settings.trigger, "trigger", allowed_user);
  }

  std::array<std::optional<unsigned>, kOutputs> outputs;
  std::optional<unsigned> trigger;

 private:
  /// Each line has one purpose.
  unsigned find_unused(gpiod_chip* chip, const GpioLine& line, const std::string& name,
                       const char* allowed_user) const {
    const unsigned offset = find_line(chip, line, "gpio." + name, allowed_user);
    for (int output = 0; output < kOutputs; ++output) {
      if (outputs[output] == offset)
        throw InputError("gpio." + name, std::string("is the line of ") + kOutputName[output]);
    }
    return offset;
  }
};

gpiod_line_value value(bool active) { return active ? GPIOD_LINE_VALUE_ACTIVE : GPIOD_LINE_VALUE_INACTIVE; }

/// Most of libgpiod's functions fail only for lack of memory.
void check(bool done, const std::string& field) {
  if (!done) throw InputError(field, std::string("cannot be requested: ") + std::strerror(errno));
}

LineRequest request_lines(gpiod_chip* chip, gpiod_line_config* lines, const std::string& consumer) {
  const RequestConfig config(gpiod_request_config_new());
  check(config != nullptr, "gpio");
  gpiod_request_config_set_consumer(config.get(), consumer.c_str());
  LineRequest request(gpiod_chip_request_lines(chip, config.get(), lines));
  check(request != nullptr, "gpio");
  return request;
}

class LibgpiodGpio : public Gpio {
 public:
  explicit LibgpiodGpio(const GpioSettings& settings) : safe_(safe_levels(settings)) {
    const Chip chip = open_chip(settings.chip);
    const LineNumbers numbers(chip.get(), settings);
    const LineConfig lines(gpiod_line_config_new());
    check(lines != nullptr, "gpio");
    for (int output = 0; output < kOutputs; ++output) {
      if (!numbers.outputs[output]) continue;
      add_output(lines.get(), *numbers.outputs[output], *settings.lines[output],
                 std::string("gpio.") + kOutputName[output]);
      output_[count_++] = output;
    }
    if (count_ > 0) request_ = request_lines(chip.get(), lines.get(), settings.consumer);
    if (settings.trigger) open_trigger(chip.get(), *settings.trigger, *numbers.trigger, settings.consumer);
  }

  ~LibgpiodGpio() override { LibgpiodGpio::set(safe_); }

  bool set(const OutputLevels& levels) override {
    if (!request_) return true;
    std::array<gpiod_line_value, kOutputs> values{};
    for (int i = 0; i < count_; ++i) values[i] = value(levels[output_[i]]);
    return gpiod_line_request_set_values(request_.get(), values.data()) == 0;  // in the order of the request
  }

  bool trigger() override {
    return trigger_ && gpiod_line_request_get_value(trigger_.get(), trigger_offset_) == GPIOD_LINE_VALUE_ACTIVE;
  }

 private:
  /// The line becomes an output at its safe level at once.
  static void add_output(gpiod_line_config* lines, unsigned offset, const OutputLine& line, const std::string& field) {
    const LineSettings settings(gpiod_line_settings_new());
    check(settings != nullptr, field);
    gpiod_line_settings_set_active_low(settings.get(), line.active_low);
    check(gpiod_line_settings_set_direction(settings.get(), GPIOD_LINE_DIRECTION_OUTPUT) == 0, field);
    check(gpiod_line_settings_set_output_value(settings.get(), value(line.safe_active)) == 0, field);
    check(gpiod_line_config_add_line_settings(lines, &offset, 1, settings.get()) == 0, field);
  }

  /// A separate request: the levels of a request that contains an input cannot be set together.
  void open_trigger(gpiod_chip* chip, const GpioLine& line, unsigned offset, const std::string& consumer) {
    const std::string field = "gpio.trigger";
    trigger_offset_ = offset;
    const LineConfig lines(gpiod_line_config_new());
    const LineSettings settings(gpiod_line_settings_new());
    check(lines && settings, field);
    gpiod_line_settings_set_active_low(settings.get(), line.active_low);
    check(gpiod_line_settings_set_direction(settings.get(), GPIOD_LINE_DIRECTION_INPUT) == 0, field);
    check(gpiod_line_config_add_line_settings(lines.get(), &trigger_offset_, 1, settings.get()) == 0, field);
    trigger_ = request_lines(chip, lines.get(), consumer);
  }

  OutputLevels safe_;
  LineRequest request_, trigger_;
  int count_ = 0;
  std::array<int, kOutputs> output_{};  // which output the request's i-th line is
  unsigned trigger_offset_ = 0;
};

}  // namespace

bool has_gpio() { return true; }

void check_gpio(const GpioSettings& settings) {
  const Chip chip = open_chip(settings.chip);
  const LineNumbers numbers(chip.get(), settings, settings.consumer.c_str());
}

std::unique_ptr<Gpio> open_gpio(const GpioSettings& settings) { return std::make_unique<LibgpiodGpio>(settings); }

}  // namespace finsight
