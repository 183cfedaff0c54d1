// Readiness and watchdog: what the service manager hears of the firmware.
#pragma once

#include <cstdint>

namespace finsight {

/// Tells systemd how the service does (sd_notify's protocol: a datagram to the socket that NOTIFY_SOCKET names). Does
/// nothing where nobody supervises. Neither allocates nor waits after construction.
class Supervisor {
 public:
  Supervisor();
  ~Supervisor();
  Supervisor(const Supervisor&) = delete;
  Supervisor& operator=(const Supervisor&) = delete;

  void ready() const;
  /// Restarts the watchdog's time, at most once per second, and says whether the sensor measures. To be called with
  /// every new frame (true), and with another answer of the camera's: that it is missing (false).
  void alive(std::int64_t now_ns, bool is_measuring);

 private:
  void send(const char* message) const;
  int socket_ = -1;
  std::int64_t last_alive_ns_ = 0;
};

}  // namespace finsight
