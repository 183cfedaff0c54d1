// Readiness and watchdog: what the firmware reports to the service manager.
#pragma once

#include <cstdint>

namespace finsight {

/// Reports to systemd (sd_notify's protocol: a datagram to the socket that NOTIFY_SOCKET names). Does nothing if there
/// is no such socket. Neither allocates nor waits after construction.
class Supervisor {
 public:
  Supervisor();
  ~Supervisor();
  Supervisor(const Supervisor&) = delete;
  Supervisor& operator=(const Supervisor&) = delete;

  void ready() const;
  /// Restarts the watchdog's time, at most once per second, and reports whether the sensor is measuring. Call it for
  /// every new frame (true), and whenever the camera was looked for and not found (false).
  void alive(std::int64_t now_ns, bool is_measuring);

 private:
  void send(const char* message) const;
  int socket_ = -1;
  std::int64_t last_alive_ns_ = 0;
};

}  // namespace finsight
