#include "hostgen/report/attack.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <deque>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "firmware/modbus/descriptor.h"

namespace finsight::host {

using nlohmann::json;

namespace {

using Clock = std::chrono::steady_clock;

constexpr std::uint32_t kLawful = 0x7F000009, kAttacker = 0x7F000002;

sockaddr_in at(std::uint32_t address, int port) {
  sockaddr_in place{};
  place.sin_family = AF_INET;
  place.sin_port = htons(static_cast<std::uint16_t>(port));
  place.sin_addr.s_addr = htonl(address);
  return place;
}

/// Not open if the connection was refused.
Descriptor connect_from(std::uint32_t address, int port) {
  Descriptor socket(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  const int on = 1;
  const timeval limit{2, 0};
  ::setsockopt(socket.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  ::setsockopt(socket.get(), IPPROTO_IP, IP_BIND_ADDRESS_NO_PORT, &on, sizeof on);
  ::setsockopt(socket.get(), SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
  ::setsockopt(socket.get(), SOL_SOCKET, SO_SNDTIMEO, &limit, sizeof limit);
  const sockaddr_in own = at(address, 0), server = at(INADDR_LOOPBACK, port);
  if (::bind(socket.get(), reinterpret_cast<const sockaddr*>(&own), sizeof own) != 0 ||
      ::connect(socket.get(), reinterpret_cast<const sockaddr*>(&server), sizeof server) != 0) {
    socket.close();
  }
  return socket;
}

void reset(Descriptor& socket) {
  const linger abort{1, 0};
  ::setsockopt(socket.get(), SOL_SOCKET, SO_LINGER, &abort, sizeof abort);
  socket.close();
}

double thread_cpu_s() {
  rusage usage{};
  ::getrusage(RUSAGE_THREAD, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

double process_cpu_s(int pid) {
  std::ifstream in("/proc/" + std::to_string(pid) + "/stat");
  std::string text;
  std::getline(in, text);
  std::istringstream rest(text.substr(text.rfind(')') + 1));
  std::string skipped;
  double user = 0, kernel = 0;
  for (int i = 0; i < 11; ++i) rest >> skipped;
  rest >> user >> kernel;
  return (user + kernel) / static_cast<double>(::sysconf(_SC_CLK_TCK));
}

/// Does something `per_second` times a second, or as often as it can, until it is stopped.
class Attacker {
 public:
  /// `act` returns how often it has done it.
  Attacker(double per_second, std::function<int()> act)
      : thread_([this, per_second, act = std::move(act)](const std::stop_token& stop) {
          const auto start = Clock::now();
          while (!stop.stop_requested()) {
            const double due = per_second * std::chrono::duration<double>(Clock::now() - start).count();
            if (per_second > 0 && static_cast<double>(actions) >= due) {
              std::this_thread::sleep_for(std::chrono::microseconds(200));
              continue;
            }
            actions += act();
            cpu_s = thread_cpu_s();
          }
        }) {}
  std::atomic<long> actions{0};
  std::atomic<double> cpu_s{0};

 private:
  std::jthread thread_;
};

const std::vector<std::uint8_t> kRead48 = {0, 1, 0, 0, 0, 6, 1, 3, 0, 0, 0, 48};
constexpr std::size_t kReply48 = 9 + 96;

class LawfulClient {
 public:
  explicit LawfulClient(int port) : socket_(connect_from(kLawful, port)) {}
  /// Register 2, the heartbeat.
  std::uint16_t read() {
    std::uint8_t reply[kReply48];
    if (::send(socket_.get(), kRead48.data(), kRead48.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(kRead48.size()) ||
        ::recv(socket_.get(), reply, sizeof reply, MSG_WAITALL) != static_cast<ssize_t>(sizeof reply)) {
      throw std::runtime_error("the lawful client was not answered");
    }
    return static_cast<std::uint16_t>(reply[13] << 8 | reply[14]);
  }

 private:
  Descriptor socket_;
};

json measure(int port, int pid, double seconds, const std::function<std::unique_ptr<Attacker>()>& attack) {
  const std::unique_ptr<Attacker> attacker = attack();
  // The client stands for one on another machine: where the system allows it, it waits for no processor here.
  ::setpriority(PRIO_PROCESS, 0, -15);
  LawfulClient client(port);
  for (int i = 0; i < 100; ++i) client.read();
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  const double process_before = process_cpu_s(pid), client_before = thread_cpu_s(),
               attacker_before = attacker ? attacker->cpu_s.load() : 0;
  const long actions_before = attacker ? attacker->actions.load() : 0;
  const auto start = Clock::now();
  auto next = start;
  const std::uint16_t first_heartbeat = client.read();
  std::uint16_t heartbeat = first_heartbeat;
  std::vector<double> us;
  double elapsed = 0;
  while (elapsed < seconds) {
    next += std::chrono::milliseconds(1);
    std::this_thread::sleep_until(next);
    const auto asked = Clock::now();
    heartbeat = client.read();
    const auto answered = Clock::now();
    us.push_back(std::chrono::duration<double, std::micro>(answered - asked).count());
    elapsed = std::chrono::duration<double>(answered - start).count();
    next = std::max(next, answered);
  }
  ::setpriority(PRIO_PROCESS, 0, 0);
  std::sort(us.begin(), us.end());
  const auto percentile = [&](double share) {
    return us[static_cast<std::size_t>(share * static_cast<double>(us.size() - 1))];
  };
  return {{"p50_us", percentile(0.5)},
          {"p99_us", percentile(0.99)},
          {"worst_ms", us.back() / 1000},
          {"heartbeat_per_s", static_cast<std::uint16_t>(heartbeat - first_heartbeat) / elapsed},
          {"reads", us.size()},
          {"attacks_per_s", attacker ? static_cast<double>(attacker->actions - actions_before) / elapsed : 0},
          {"server_cpu", (process_cpu_s(pid) - process_before) / elapsed},
          {"attacker_cpu", attacker ? (attacker->cpu_s - attacker_before) / elapsed : 0},
          {"client_cpu", (thread_cpu_s() - client_before) / elapsed}};
}

/// Connects, and keeps so many connections; the oldest is closed for a new one.
std::unique_ptr<Attacker> holder(int port, double per_second, std::size_t kept) {
  return std::make_unique<Attacker>(per_second, [port, kept, held = std::make_shared<std::deque<Descriptor>>()] {
    held->push_back(connect_from(kAttacker, port));
    if (held->size() > kept) {
      reset(held->front());
      held->pop_front();
    }
    return 1;
  });
}

std::unique_ptr<Attacker> mute(int port) {
  auto held = std::make_shared<std::vector<Descriptor>>();
  for (int i = 0; i < 64; ++i) held->push_back(connect_from(kAttacker, port));
  return std::make_unique<Attacker>(1, [port, held] {  // those that were closed come back
    for (Descriptor& socket : *held) {
      pollfd closed{socket.get(), POLLIN, 0};
      if (!socket.is_open() || ::poll(&closed, 1, 0) > 0) socket = connect_from(kAttacker, port);
    }
    return 1;
  });
}

/// Sends requests as fast as they are taken, and reads the answers; counts these.
std::unique_ptr<Attacker> pipeline(int port) {
  auto socket = std::make_shared<Descriptor>(connect_from(kAttacker, port));
  std::vector<std::uint8_t> requests;
  for (int i = 0; i < 200; ++i) requests.insert(requests.end(), kRead48.begin(), kRead48.end());
  return std::make_unique<Attacker>(0, [port, socket, requests, read = std::size_t{0}]() mutable {
    pollfd ready{socket->get(), POLLIN | POLLOUT, 0};
    ::poll(&ready, 1, 10);
    if (ready.revents & POLLOUT) ::send(socket->get(), requests.data(), requests.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    std::uint8_t answers[65536];
    const ssize_t got = ::recv(socket->get(), answers, sizeof answers, MSG_DONTWAIT);
    if (got == 0 || (got < 0 && errno != EAGAIN)) *socket = connect_from(kAttacker, port);
    if (got <= 0) return 0;
    read += static_cast<std::size_t>(got);
    const auto whole = static_cast<int>(read / kReply48);
    read %= kReply48;
    return whole;
  });
}

}  // namespace

json measure_attacks(int port, int pid, double seconds) {
  json figures;
  figures["alone"] = measure(port, pid, seconds, [] { return std::unique_ptr<Attacker>(); });
  figures["mute_64"] = measure(port, pid, seconds, [&] { return mute(port); });
  figures["connect_reset"] = measure(port, pid, seconds, [&] { return holder(port, 18000, 0); });
  figures["connect_hold"] = measure(port, pid, seconds, [&] { return holder(port, 17000, 500); });
  figures["pipeline"] = measure(port, pid, seconds, [&] { return pipeline(port); });
  return figures;
}

}  // namespace finsight::host
