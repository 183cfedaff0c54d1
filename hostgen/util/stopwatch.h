// How long something took.
#pragma once

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

}  // namespace finsight::host
