// How long something took.
#pragma once

#include <time.h>

#include <chrono>

namespace finsight::host {

class Stopwatch {
 public:
  /// Since the last call, or since the start.
  double lap_s() {
    const auto now = std::chrono::steady_clock::now();
    const std::chrono::duration<double> lap = now - last_;
    last_ = now;
    return lap.count();
  }
  double lap_us() { return 1e6 * lap_s(); }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

/// The same of the processor time of this thread: while other programs have the processor it stands still.
class ProcessorStopwatch {
 public:
  double lap_us() {
    const double now = now_us(), lap = now - last_us_;
    last_us_ = now;
    return lap;
  }

 private:
  static double now_us() {
    timespec now{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return 1e6 * static_cast<double>(now.tv_sec) + 1e-3 * static_cast<double>(now.tv_nsec);
  }
  double last_us_ = now_us();
};

}  // namespace finsight::host
