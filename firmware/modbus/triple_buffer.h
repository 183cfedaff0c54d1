// Hands the latest value from one thread to another.
#pragma once

#include <array>
#include <atomic>

namespace finsight {

/// Three slots: one is written, one is read, and one between them holds the latest value. One thread publishes, one
/// reads, and neither ever waits.
template <class T>
class TripleBuffer {
 public:
  explicit TripleBuffer(const T& first) { slots_.fill(first); }
  void publish(const T& value) {
    slots_[writing_] = value;
    writing_ = between_.exchange(writing_ | kNew, std::memory_order_acq_rel) & kSlot;
  }
  /// The latest value; the reference is valid until the next read.
  const T& read() {
    if (between_.load(std::memory_order_relaxed) & kNew) {
      reading_ = between_.exchange(reading_, std::memory_order_acq_rel) & kSlot;
    }
    return slots_[reading_];
  }

 private:
  static constexpr unsigned kSlot = 3, kNew = 4;
  std::array<T, 3> slots_;
  unsigned writing_ = 0, reading_ = 1;
  std::atomic<unsigned> between_{2};
};

}  // namespace finsight
