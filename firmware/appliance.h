// What finsightd needs of the system that it runs on when it is a device: real-time priority, the supervisor that
// restarts it, and the network settings that stand in the same file as its own.
#pragma once

#include <sched.h>

#include <cstdint>
#include <string>

namespace finsight {

struct RealtimeSettings {
  int priority = 0;  ///< of SCHED_FIFO; 0: the ordinary scheduler
  int cpu = -1;      ///< the processor that the frame loop stays on; -1: any
  bool lock_memory = false;
};

/// Applies to the calling thread (the lock to the whole process). Throws std::runtime_error for what the system
/// refuses.
void make_realtime(const RealtimeSettings& settings);

/// The calling thread as it was before make_realtime(), for a start anew: threads inherit their processor.
class OrdinaryThread {
 public:
  OrdinaryThread();
  void restore() const;

 private:
  cpu_set_t cpus_;
};

struct NetworkSettings {
  std::string address;  ///< with prefix length; empty: from a DHCP server
  std::string gateway;  ///< empty: none
};

/// Dotted decimal, with a prefix length ("/24") or without.
bool is_ipv4(const std::string& text, bool with_prefix);

/// The settings as a .network file of systemd-networkd, for every Ethernet port.
std::string networkd_file(const NetworkSettings& settings);

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
