// The register image on its way from the frame loop to a thread that answers clients.
#pragma once

#include <array>
#include <atomic>
#include <chrono>

#include "firmware/modbus/registers.h"
#include "firmware/types.h"

namespace finsight {

/// Three images in rotation: one being written, one being read, one between them that holds the latest.
/// One thread publishes, one reads; neither ever waits. Before the first publication: not ready, no valid value.
class LatestImage {
 public:
  LatestImage() {
    encode_registers(PlatePoses{}, FingerShape{}, Touch{}, LoopState{}, slots_[between_.load() & kSlot]);
  }
  void publish(const RegisterImage& image) {
    slots_[writing_] = image;
    writing_ = between_.exchange(writing_ | kNew, std::memory_order_acq_rel) & kSlot;
  }
  /// The last published one, with the age at this moment.
  RegisterImage read() {
    if (between_.load(std::memory_order_relaxed) & kNew) {
      reading_ = between_.exchange(reading_, std::memory_order_acq_rel) & kSlot;
    }
    RegisterImage image = slots_[reading_];
    const auto now = std::chrono::steady_clock::now().time_since_epoch();
    set_age(image, std::chrono::duration_cast<std::chrono::nanoseconds>(now).count());
    return image;
  }

 private:
  static constexpr unsigned kSlot = 3, kNew = 4;
  std::array<RegisterImage, 3> slots_;
  unsigned writing_ = 0, reading_ = 1;
  std::atomic<unsigned> between_{2 | kNew};
};

}  // namespace finsight
