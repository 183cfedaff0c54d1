// Readiness and watchdog: what finsightd and finsight-page report to the service manager.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>

namespace finsight {

/// Reports to systemd (sd_notify's protocol: a datagram to the socket that NOTIFY_SOCKET names). Does nothing if there
/// is no such socket. Neither allocates nor waits after construction.
class Supervisor {
 public:
  explicit Supervisor(std::size_t fingers = 1);
  ~Supervisor();
  Supervisor(const Supervisor&) = delete;
  Supervisor& operator=(const Supervisor&) = delete;

  void ready() const;
  /// Restarts the watchdog's time, at most once per second and once every finger has given a sign of life since the
  /// last time, and reports whether all of them are measuring. Call it for every new frame (true), and whenever the
  /// camera was looked for and not found (false). For the threads of all fingers.
  void alive(std::int64_t now_ns, bool is_measuring, std::size_t finger = 0);
  /// The same where nothing is measured: in safe mode, and by the page.
  void alive_without_sensor(std::int64_t now_ns, std::size_t finger = 0);

 private:
  void send_once_per_second(std::int64_t now_ns, std::size_t finger, const char* message);
  void send(const char* message) const;
  int socket_ = -1;
  const unsigned all_;  ///< a bit for each finger
  std::atomic<unsigned> alive_{0}, measuring_{0};
  std::atomic<std::int64_t> last_alive_ns_{0};
};

}  // namespace finsight
