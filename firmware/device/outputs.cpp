#include "firmware/device/outputs.h"

namespace finsight {

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
  constexpr std::int64_t kNsPerMs = 1'000'000;
  const OutputLevels wanted = output_levels(status, settings[kLight] != 0, safe_);
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

}  // namespace finsight
