#pragma once

#include <chrono>

namespace finsight::host {

class Stopwatch {
 public:
  /// Since the last call, or since the start.
  double lap_us() {
    const auto now = std::chrono::steady_clock::now();
    const double us = std::chrono::duration<double, std::micro>(now - last_).count();
    last_ = now;
    return us;
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

}  // namespace finsight::host
