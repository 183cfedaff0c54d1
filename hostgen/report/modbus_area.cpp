// How long a Modbus client waits.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <nlohmann/json.hpp>
#include <system_error>
#include <thread>
#include <vector>

#include "firmware/modbus/server.h"
#include "hostgen/report/areas.h"
#include "hostgen/util/stopwatch.h"

namespace finsight::host {

using nlohmann::json;

namespace {

/// A plain blocking client: sends bytes, waits for the whole answer.
class RawClient {
 public:
  explicit RawClient(int port) : fd_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const int on = 1;
    if (fd_ < 0 || connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0 ||
        setsockopt(fd_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on) != 0) {
      throw std::system_error(errno, std::generic_category(), "Modbus client");
    }
  }
  ~RawClient() { close(fd_); }
  RawClient(const RawClient&) = delete;
  RawClient& operator=(const RawClient&) = delete;

  void exchange(const std::vector<std::uint8_t>& pdu) {
    std::vector<std::uint8_t> frame = {0, 1, 0, 0, 0, static_cast<std::uint8_t>(pdu.size() + 1), 1};
    frame.insert(frame.end(), pdu.begin(), pdu.end());
    if (send(fd_, frame.data(), frame.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(frame.size())) fail();
    std::uint8_t answer[260];
    receive(answer, 6);
    receive(answer + 6, static_cast<std::size_t>(answer[4] << 8 | answer[5]));
  }

 private:
  [[noreturn]] static void fail() { throw std::runtime_error("the Modbus server closed the connection"); }
  void receive(std::uint8_t* bytes, std::size_t count) const {
    for (std::size_t got = 0; got < count;) {
      const ssize_t n = recv(fd_, bytes + got, count - got, 0);
      if (n <= 0) fail();
      got += static_cast<std::size_t>(n);
    }
  }
  int fd_;
};

/// Microseconds of `count` reads of registers 0 to 47, ascending.
std::vector<double> read_times_us(RawClient& client, int count) {
  std::vector<double> us;
  for (int i = 0; i < count; ++i) {
    Stopwatch watch;
    client.exchange({3, 0, 0, 0, 48});
    us.push_back(watch.lap_us());
  }
  std::sort(us.begin(), us.end());
  return us;
}

}  // namespace

json measure_modbus(bool quick) {
  const int reads = quick ? 5000 : 50000;
  Control control;
  ModbusServer server({.port = 0}, control);
  RawClient client(server.port());
  read_times_us(client, 100);
  const std::vector<double> alone = read_times_us(client, reads);

  // Sends the functions that libmodbus sleeps on, one after the other, while the client goes on reading.
  std::atomic<bool> stop{false};
  std::jthread hostile([&] {
    RawClient enemy(server.port());
    while (!stop) {
      enemy.exchange({43, 13, 0});
      enemy.exchange({8, 0, 0, 0, 0});
      enemy.exchange({7});
      enemy.exchange({3, 0, 0, 0, 126});
    }
  });
  const std::vector<double> beside = read_times_us(client, reads);
  stop = true;
  const auto at = [](const std::vector<double>& sorted, double share) {
    return sorted[static_cast<std::size_t>(share * static_cast<double>(sorted.size() - 1))];
  };
  return {{"modbus",
           {{"read_us_p50", at(alone, 0.5)},
            {"read_us_p99", at(alone, 0.99)},
            {"hostile_read_us_p50", at(beside, 0.5)},
            {"hostile_worst_ms", beside.back() / 1000},
            {"reads", reads}}}};
}

}  // namespace finsight::host
