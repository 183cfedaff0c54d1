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
  void alive(std::int64_t now_ns, bool is_measuring) {
    send_once_per_second(now_ns,
                         is_measuring ? "WATCHDOG=1\nSTATUS=measuring" : "WATCHDOG=1\nSTATUS=looking for the camera");
  }
  /// The same in safe mode, which has no sensor.
  void alive_in_safe_mode(std::int64_t now_ns) { send_once_per_second(now_ns, "WATCHDOG=1\nSTATUS=safe mode"); }

 private:
  void send_once_per_second(std::int64_t now_ns, const char* message);
  void send(const char* message) const;
  int socket_ = -1;
  std::int64_t last_alive_ns_ = 0;
};

}  // namespace finsight
