// The GPIO port against a recording stand-in for libgpiod: the functions below replace the library's.
#include <doctest/doctest.h>
#include <gpiod.h>

#include <cerrno>
#include <map>
#include <vector>

#include "firmware/input_error.h"
#include "firmware/ports/gpio.h"

using namespace finsight;

struct gpiod_chip {};
struct gpiod_line_info {
  bool used;
};
struct gpiod_line_settings {
  bool active_low = false;
  gpiod_line_direction direction = GPIOD_LINE_DIRECTION_AS_IS;
  gpiod_line_value value = GPIOD_LINE_VALUE_INACTIVE;
};
struct gpiod_line_config {
  std::vector<std::pair<unsigned, gpiod_line_settings>> lines;
};
struct gpiod_request_config {
  std::string consumer;
};
struct gpiod_line_request {};

namespace {

constexpr unsigned kLines = 8, kTakenLine = 3;

struct Recorder {
  int objects = 0;  // allocated and not freed
  gpiod_line_config config;
  std::string consumer;
  int requested = 0;
  bool refuses = false, trigger = false;
  std::vector<std::vector<bool>> sets;
};
Recorder recorder;

template <class T>
T* made(T object = {}) {
  ++recorder.objects;
  return new T(object);
}
template <class T>
void freed(T* object) {
  if (!object) return;
  --recorder.objects;
  delete object;
}

GpioSettings settings() {
  GpioSettings result{.chip = "/dev/gpiochip0", .consumer = "finsight", .lines = {}, .trigger = std::nullopt};
  result.lines[kContactOutput] = OutputLine{{.name = "TOUCH", .number = 0, .active_low = false}, true};
  result.lines[kHealthyOutput] = OutputLine{{.name = "", .number = 5, .active_low = true}, false};
  return result;
}

std::string refusal(const GpioSettings& wrong) {
  try {
    open_gpio(wrong);
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

bool says(const std::string& text, const char* part) { return text.find(part) != std::string::npos; }

}  // namespace

extern "C" {
gpiod_chip* gpiod_chip_open(const char* path) {
  if (std::string(path) == "/dev/gpiochip0") return made<gpiod_chip>();
  errno = ENOENT;
  return nullptr;
}
void gpiod_chip_close(gpiod_chip* chip) { freed(chip); }
int gpiod_chip_get_line_offset_from_name(gpiod_chip*, const char* name) {
  return std::string(name) == "TOUCH" ? 2 : -1;
}
gpiod_line_info* gpiod_chip_get_line_info(gpiod_chip*, unsigned offset) {
  if (offset < kLines) return made(gpiod_line_info{offset == kTakenLine});
  errno = EINVAL;
  return nullptr;
}
void gpiod_line_info_free(gpiod_line_info* info) { freed(info); }
bool gpiod_line_info_is_used(gpiod_line_info* info) { return info->used; }
const char* gpiod_line_info_get_consumer(gpiod_line_info*) { return "power button"; }
gpiod_line_settings* gpiod_line_settings_new() { return made<gpiod_line_settings>(); }
void gpiod_line_settings_free(gpiod_line_settings* settings) { freed(settings); }
void gpiod_line_settings_set_active_low(gpiod_line_settings* settings, bool active_low) {
  settings->active_low = active_low;
}
int gpiod_line_settings_set_direction(gpiod_line_settings* settings, gpiod_line_direction direction) {
  settings->direction = direction;
  return 0;
}
int gpiod_line_settings_set_output_value(gpiod_line_settings* settings, gpiod_line_value value) {
  settings->value = value;
  return 0;
}
gpiod_line_config* gpiod_line_config_new() { return made<gpiod_line_config>(); }
void gpiod_line_config_free(gpiod_line_config* config) { freed(config); }
int gpiod_line_config_add_line_settings(gpiod_line_config* config, const unsigned* offsets, size_t count,
                                        gpiod_line_settings* settings) {
  for (size_t i = 0; i < count; ++i) config->lines.emplace_back(offsets[i], *settings);
  return 0;
}
gpiod_request_config* gpiod_request_config_new() { return made<gpiod_request_config>(); }
void gpiod_request_config_free(gpiod_request_config* config) { freed(config); }
void gpiod_request_config_set_consumer(gpiod_request_config* config, const char* consumer) {
  config->consumer = consumer;
}
gpiod_line_request* gpiod_chip_request_lines(gpiod_chip*, gpiod_request_config* request, gpiod_line_config* config) {
  recorder.config = *config;
  recorder.consumer = request->consumer;
  ++recorder.requested;
  return made<gpiod_line_request>();
}
void gpiod_line_request_release(gpiod_line_request* request) {
  --recorder.requested;
  freed(request);
}
gpiod_line_value gpiod_line_request_get_value(gpiod_line_request*, unsigned offset) {
  return recorder.trigger && offset == 6 ? GPIOD_LINE_VALUE_ACTIVE : GPIOD_LINE_VALUE_INACTIVE;
}
int gpiod_line_request_set_values(gpiod_line_request*, const gpiod_line_value* values) {
  if (recorder.refuses) return -1;
  std::vector<bool> levels;
  for (size_t i = 0; i < recorder.config.lines.size(); ++i) levels.push_back(values[i] == GPIOD_LINE_VALUE_ACTIVE);
  recorder.sets.push_back(levels);
  return 0;
}
}

TEST_CASE("gpio: lines are taken by name or number, as outputs at their safe levels, under the consumer's name") {
  recorder = {};
  const auto gpio = open_gpio(settings());
  CHECK(recorder.consumer == "finsight");
  REQUIRE(recorder.config.lines.size() == 2);
  const auto& [contact, contact_line] = recorder.config.lines[0];
  CHECK(contact == 2);
  CHECK(contact_line.direction == GPIOD_LINE_DIRECTION_OUTPUT);
  CHECK(contact_line.value == GPIOD_LINE_VALUE_ACTIVE);
  CHECK(!contact_line.active_low);
  const auto& [healthy, healthy_line] = recorder.config.lines[1];
  CHECK(healthy == 5);
  CHECK(healthy_line.direction == GPIOD_LINE_DIRECTION_OUTPUT);
  CHECK(healthy_line.value == GPIOD_LINE_VALUE_INACTIVE);
  CHECK(healthy_line.active_low);
}

TEST_CASE("gpio: levels are set together on the lines that exist; at the end they are safe and the lines released") {
  recorder = {};
  {
    const auto gpio = open_gpio(settings());
    CHECK(gpio->set({false, true, true, true}));
    CHECK(gpio->set({true, true, false, true}));
    CHECK(recorder.requested);
  }
  CHECK(recorder.sets == std::vector<std::vector<bool>>{{false, true}, {true, false}, {true, false}});
  CHECK(recorder.requested == 0);
  CHECK(recorder.objects == 0);
}

TEST_CASE("gpio: the trigger is an input in a separate request") {
  recorder = {};
  GpioSettings with_trigger = settings();
  with_trigger.trigger = GpioLine{.name = "", .number = 6, .active_low = true};
  {
    const auto gpio = open_gpio(with_trigger);
    CHECK(recorder.requested == 2);
    REQUIRE(recorder.config.lines.size() == 1);
    CHECK(recorder.config.lines[0].first == 6);
    CHECK(recorder.config.lines[0].second.direction == GPIOD_LINE_DIRECTION_INPUT);
    CHECK(recorder.config.lines[0].second.active_low);
    CHECK(!gpio->trigger());
    recorder.trigger = true;
    CHECK(gpio->trigger());
  }
  CHECK(recorder.requested == 0);
  CHECK(recorder.objects == 0);
  with_trigger.trigger->number = 5;
  CHECK(says(refusal(with_trigger), "gpio.trigger: is the line of healthy"));
  CHECK(!open_gpio(settings())->trigger());
}

TEST_CASE("gpio: a refusal by the chip is reported") {
  recorder = {};
  const auto gpio = open_gpio(settings());
  recorder.refuses = true;
  CHECK(!gpio->set({true, true, true, true}));
}

TEST_CASE("gpio: a line that does not exist, is in use or named twice is refused by name, and nothing leaks") {
  recorder = {};
  GpioSettings wrong = settings();
  wrong.chip = "/dev/gpiochip9";
  CHECK(says(refusal(wrong), "/dev/gpiochip9"));
  wrong.chip = "no such label";
  CHECK(says(refusal(wrong), "no such label"));
  wrong = settings();
  wrong.lines[kContactOutput]->name = "GPIO99";
  CHECK(says(refusal(wrong), "GPIO99"));
  wrong = settings();
  wrong.lines[kHealthyOutput]->number = kLines;
  CHECK(says(refusal(wrong), "no line 8"));
  wrong.lines[kHealthyOutput]->number = kTakenLine;
  CHECK(says(refusal(wrong), "power button"));
  wrong.lines[kHealthyOutput]->number = 2;  // the number of "TOUCH"
  CHECK(says(refusal(wrong), "gpio.healthy: is the line of contact"));
  CHECK(recorder.objects == 0);
}

TEST_CASE("gpio: a check refuses what opening refuses, takes no line, and does not mind those that a finsightd has") {
  recorder = {};
  check_gpio(settings());
  GpioSettings wrong = settings();
  wrong.lines[kHealthyOutput]->number = kLines;
  CHECK_THROWS_WITH_AS(check_gpio(wrong), doctest::Contains("no line 8"), InputError);
  wrong.lines[kHealthyOutput]->number = kTakenLine;
  CHECK_THROWS_WITH_AS(check_gpio(wrong), doctest::Contains("power button"), InputError);
  wrong.consumer = "power button";
  check_gpio(wrong);
  CHECK(recorder.requested == 0);
  CHECK(recorder.sets.empty());
  CHECK(recorder.objects == 0);
}
