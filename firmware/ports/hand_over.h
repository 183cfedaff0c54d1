// Values on their way from one thread to another.
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <optional>
#include <semaphore>

namespace finsight {

/// A queue for one writing and one reading thread. Neither ever holds a lock that the other waits for, so an ordinary
/// thread that is interrupted does not delay a real-time one. Does not allocate.
template <class T, unsigned kSlots>
class HandOver {
  static_assert((kSlots & (kSlots - 1)) == 0, "the counters wrap around at a multiple of a power of two");

 public:
  /// False: full.
  bool put(const T& value) {
    const unsigned head = head_.load(std::memory_order_relaxed);
    if (head - tail_.load(std::memory_order_acquire) == kSlots) return false;
    slots_[head % kSlots] = value;
    head_.store(head + 1, std::memory_order_release);
    wake();
    return true;
  }
  /// Ends one wait of the reader.
  void wake() { events_.release(); }

  /// The oldest value, or nothing.
  std::optional<T> take() {
    const unsigned tail = tail_.load(std::memory_order_relaxed);
    if (tail == head_.load(std::memory_order_acquire)) return std::nullopt;
    const T value = slots_[tail % kSlots];
    tail_.store(tail + 1, std::memory_order_release);
    return value;
  }
  /// Waits for a put() or wake() that has not ended a wait before; its value may have been taken already. False: none
  /// came until then.
  bool wait_until(std::chrono::steady_clock::time_point limit) { return events_.try_acquire_until(limit); }

 private:
  std::array<T, kSlots> slots_{};
  std::atomic<unsigned> head_{0}, tail_{0};  ///< values put and taken since the start
  std::counting_semaphore<> events_{0};
};

}  // namespace finsight
