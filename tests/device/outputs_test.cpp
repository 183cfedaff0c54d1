#include "firmware/device/outputs.h"

#include <doctest/doctest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>
#include <vector>

using namespace finsight;

namespace {

constexpr OutputLevels kSafe = {true, true, false, false};
constexpr std::int64_t kMs = 1'000'000;

/// A chip that records every level that was set.
class RecordingGpio : public Gpio {
 public:
  bool set(const OutputLevels& levels) override {
    sets.push_back(levels);
    return true;
  }
  bool trigger() override { return level; }
  std::vector<OutputLevels> sets;
  bool level = false;
};

}  // namespace

TEST_CASE("outputs: without a fault every line follows its bit of the status word") {
  CHECK(output_levels(0, false, kSafe) == OutputLevels{false, false, false, false});
  CHECK(output_levels(kReady, false, kSafe) == OutputLevels{false, false, true, false});
  CHECK(output_levels(kReady | kContact, false, kSafe) == OutputLevels{true, false, true, false});
  CHECK(output_levels(kReady | kOverRange, false, kSafe) == OutputLevels{false, true, true, false});
  CHECK(output_levels(kReady | kOverload, false, kSafe) == OutputLevels{false, true, true, false});
}

TEST_CASE(
    "outputs: with any fault the lines are safe, whatever else the status word says, and the light does not change") {
  for (const unsigned others : {0U, 0x7fffU, unsigned{kReady}, unsigned{kReady | kContact}}) {
    CHECK(output_levels(static_cast<std::uint16_t>(kAnyFault | others), false, kSafe) == kSafe);
    CHECK(output_levels(static_cast<std::uint16_t>(kAnyFault | others), true, kSafe)[kLightOutput]);
  }
}

TEST_CASE("outputs: the safe levels come from the settings; an output without a line is inactive") {
  GpioSettings settings;
  CHECK(safe_levels(settings) == OutputLevels{});
  settings.lines[kOverloadOutput] = OutputLine{};
  settings.lines[kOverloadOutput]->safe_active = true;
  CHECK(safe_levels(settings) == OutputLevels{false, true, false, false});
}

TEST_CASE("outputs: without debouncing a change is set with its frame") {
  OutputFilter filter(kSafe);
  RuntimeSettings settings;
  CHECK(filter.next(kReady, settings, kMs) == OutputLevels{false, false, true, true});
  CHECK(filter.next(kReady | kContact, settings, 2 * kMs) == OutputLevels{true, false, true, true});
  CHECK(filter.next(kReady, settings, 3 * kMs) == OutputLevels{false, false, true, true});
}

TEST_CASE("outputs: with debouncing a level must last; a shorter one is never set") {
  OutputFilter filter(kSafe);
  RuntimeSettings settings;
  RecordingGpio gpio;
  filter.next(kReady, settings, 0);
  settings[kOutputDebounce] = 50;
  const auto contact_at = [&](int ms, bool contact) {
    gpio.set(filter.next(static_cast<std::uint16_t>(kReady | (contact ? kContact : 0)), settings, ms * kMs));
    return gpio.sets.back()[kContactOutput];
  };
  CHECK_FALSE(contact_at(100, true));
  CHECK_FALSE(contact_at(149, true));
  CHECK_FALSE(contact_at(150, false));  // bounced
  CHECK_FALSE(contact_at(160, true));
  CHECK_FALSE(contact_at(209, true));
  CHECK(contact_at(210, true));
  CHECK(contact_at(220, false));
  CHECK_FALSE(contact_at(270, false));
}

TEST_CASE("outputs: safe levels and the light never wait") {
  OutputFilter filter(kSafe);
  RuntimeSettings settings;
  filter.next(kReady, settings, 0);
  settings[kOutputDebounce] = 1000;
  settings[kLight] = 0;
  CHECK(filter.next(kReady | kAnyFault, settings, kMs) == OutputLevels{true, true, false, false});
}

TEST_CASE("outputs: a trigger is a rising edge; a line that is active from the start does not trigger") {
  TriggerInput trigger;
  RecordingGpio gpio;
  gpio.level = true;
  CHECK_FALSE(trigger.rises(gpio.trigger()));
  gpio.level = false;
  CHECK_FALSE(trigger.rises(gpio.trigger()));
  gpio.level = true;
  CHECK(trigger.rises(gpio.trigger()));
  CHECK_FALSE(trigger.rises(gpio.trigger()));
}

TEST_CASE("outputs: a crash sets the safe levels before the program ends with its signal") {
  /// Writes the levels to a pipe.
  struct PipeGpio : Gpio {
    explicit PipeGpio(int fd) : pipe(fd) {}
    bool set(const OutputLevels& levels) override { return write(pipe, levels.data(), kOutputs) == kOutputs; }
    bool trigger() override { return false; }
    int pipe;
  };
  int ends[2];
  REQUIRE(pipe(ends) == 0);
  const pid_t child = fork();
  if (child == 0) {
    DigitalOutputs outputs(std::make_unique<PipeGpio>(ends[1]), kSafe);
    RegisterImage image;
    image.words[0] = kReady | kContact;
    RuntimeSettings settings;
    settings[kLight] = 0;
    outputs.set(image, settings);
    std::raise(SIGABRT);
    _exit(0);
  }
  close(ends[1]);
  OutputLevels levels{};
  REQUIRE(read(ends[0], levels.data(), kOutputs) == kOutputs);
  CHECK(levels == OutputLevels{true, false, true, false});
  REQUIRE(read(ends[0], levels.data(), kOutputs) == kOutputs);
  CHECK(levels == kSafe);
  CHECK(read(ends[0], levels.data(), kOutputs) == 0);
  close(ends[0]);
  int status = 0;
  REQUIRE(waitpid(child, &status, 0) == child);
  CHECK(WIFSIGNALED(status));
  CHECK(WTERMSIG(status) == SIGABRT);
}

TEST_CASE("outputs: without lines setting them always succeeds") {
  DigitalOutputs none(std::nullopt);
  CHECK(none.set(RegisterImage{}, RuntimeSettings{}));
  CHECK_FALSE(none.trigger_rises());
}
