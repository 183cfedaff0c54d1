#include "firmware/device/outputs.h"

#include <algorithm>
#include <atomic>
#include <cassert>
#include <chrono>
#include <csignal>
#include <thread>

#include "firmware/input_error.h"

namespace finsight {

namespace {

// For the signal handler, one for each finger: the chip is set after the levels, and cleared before it is closed.
struct OnCrash {
  OutputLevels safe{};
  std::atomic<Gpio*> gpio{nullptr};
};
std::array<OnCrash, kMostFingers> all_on_crash;

void on_crash(int signal) {
  for (OnCrash& crash : all_on_crash) {
    if (Gpio* gpio = crash.gpio) gpio->set(crash.safe);
  }
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

constexpr std::chrono::milliseconds kPatience(10'000), kBetweenTries(20);

std::unique_ptr<Gpio> open_patiently(const GpioSettings& settings) {
  for (const auto end = std::chrono::steady_clock::now() + kPatience;; std::this_thread::sleep_for(kBetweenTries)) {
    try {
      return open_gpio(settings);
    } catch (const InputError&) {
      if (!has_gpio() || std::chrono::steady_clock::now() > end) throw;
    }
  }
}

}  // namespace

OutputLevels output_levels(std::uint16_t status, bool light, const OutputLevels& safe) {
  OutputLevels levels = safe;
  if (!(status & kAnyFault)) {
    levels[kContactOutput] = (status & kContact) != 0;
    levels[kOverloadOutput] = (status & (kOverRange | kOverload)) != 0;
    levels[kHealthyOutput] = (status & kReady) != 0;
  }
  levels[kLightOutput] = light;
  return levels;
}

const OutputLevels& OutputFilter::next(std::uint16_t status, const RuntimeSettings& settings, std::int64_t now_ns) {
  const OutputLevels wanted = output_levels(status, settings[kLight] == value_named("light", "on"), safe_);
  const bool at_once = (status & kAnyFault) || settings[kOutputDebounce] == 0;
  for (std::size_t i = 0; i < kOutputs; ++i) {
    std::int64_t& since = changing_since_ns_[i];
    if (wanted[i] == shown_[i]) {
      since = 0;
      continue;
    }
    if (since == 0) since = now_ns;
    if (at_once || i == kLightOutput || now_ns - since >= kNsPerMs * settings[kOutputDebounce]) {
      shown_[i] = wanted[i];
      since = 0;
    }
  }
  return shown_;
}

DigitalOutputs::DigitalOutputs(const std::optional<GpioSettings>& settings)
    : DigitalOutputs(settings ? open_patiently(*settings) : nullptr,
                     settings ? safe_levels(*settings) : OutputLevels{}) {}

DigitalOutputs::DigitalOutputs(std::unique_ptr<Gpio> gpio, const OutputLevels& safe)
    : filter_(safe), gpio_(std::move(gpio)) {
  if (!gpio_) return;
  const auto free = std::ranges::find_if(all_on_crash, [](const OnCrash& crash) { return !crash.gpio; });
  assert(free != all_on_crash.end());
  free->safe = safe;
  free->gpio = gpio_.get();
  for (const int fault : {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL}) std::signal(fault, on_crash);
}

DigitalOutputs::~DigitalOutputs() {
  for (OnCrash& crash : all_on_crash) {
    if (gpio_ && crash.gpio == gpio_.get()) crash.gpio = nullptr;
  }
}

bool DigitalOutputs::set(const RegisterImage& image, const RuntimeSettings& settings) {
  return !gpio_ || gpio_->set(filter_.next(image.words[0], settings, steady_now_ns()));
}

}  // namespace finsight
