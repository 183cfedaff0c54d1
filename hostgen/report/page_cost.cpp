#include "hostgen/report/page_cost.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <algorithm>
#include <atomic>
#include <charconv>
#include <chrono>
#include <list>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "firmware/modbus/descriptor.h"
#include "firmware/modbus/register_table.h"
#include "firmware/published/block.h"

namespace finsight::host {

using nlohmann::json;
using namespace std::chrono_literals;

namespace {

constexpr auto kPause = 70ms;     // between an answer and the next question, as in assets/camera.js and finger3d.js
constexpr auto kSettle = 2500ms;  // the device publishes pictures for two seconds after the last question
constexpr auto kLook = 2ms;       // far shorter than a frame
constexpr std::size_t kDropped = address_of("dropped_frames");
constexpr double kShare = 0.01, kLeast_us = 30;  // what the watchers may cost: the larger of the two

/// One connection that asks again and again.
class HttpClient {
 public:
  explicit HttpClient(int port) : socket_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in server{};
    server.sin_family = AF_INET;
    server.sin_port = htons(static_cast<std::uint16_t>(port));
    server.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const timeval limit{2, 0};
    ::setsockopt(socket_.get(), SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    if (::connect(socket_.get(), reinterpret_cast<const sockaddr*>(&server), sizeof server) != 0) fail();
  }
  void ask(const std::string& path) {
    const std::string request = "GET " + path + " HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n";
    if (::send(socket_.get(), request.data(), request.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(request.size())) {
      fail();
    }
  }
  /// Some bytes of an answer that does not end; 0 if none came within two seconds.
  std::size_t take() {
    const ssize_t got = ::recv(socket_.get(), buffer_, sizeof buffer_, 0);
    if (got == 0) fail();
    return got < 0 ? 0 : static_cast<std::size_t>(got);
  }
  /// The status of a whole answer with its length in its head.
  int answer() {
    std::string text;
    std::size_t head = std::string::npos, length = 0;
    do {
      const std::size_t got = take();
      if (got == 0) fail();
      text.append(buffer_, got);
      if (head == std::string::npos && (head = text.find("\r\n\r\n")) != std::string::npos) length = length_in(text);
    } while (head == std::string::npos || text.size() < head + 4 + length);
    return number_at(text, text.find(' ') + 1);
  }

 private:
  [[noreturn]] static void fail() { throw std::runtime_error("the page closed a connection or did not answer"); }
  static int number_at(const std::string& text, std::size_t at) {
    int number = 0;
    std::from_chars(text.data() + std::min(at, text.size()), text.data() + text.size(), number);
    return number;
  }
  static std::size_t length_in(const std::string& text) {
    constexpr std::string_view kName = "Content-Length: ";
    const std::size_t at = text.find(kName);
    return at == std::string::npos ? 0 : static_cast<std::size_t>(number_at(text, at + kName.size()));
  }
  Descriptor socket_;
  char buffer_[65536] = {};
};

struct Taken {
  std::atomic<long> pictures{0}, shapes{0}, event_bytes{0};
  std::atomic<bool> failed{false};
};

/// What a browser with the page Live open does, without drawing anything.
class Browser {
 public:
  Browser(int port, Taken& taken) {
    start(taken, [port, &taken](const std::stop_token& stop) {
      HttpClient client(port);
      client.ask("/api/events");
      while (!stop.stop_requested()) taken.event_bytes += static_cast<long>(client.take());
    });
    const auto keep_asking = [this, &taken, port](const char* path, auto& counter) {
      start(taken, [port, path, &counter](const std::stop_token& stop) {
        HttpClient client(port);
        while (!stop.stop_requested()) {
          client.ask(path);
          if (client.answer() == 200) ++counter;
          std::this_thread::sleep_for(kPause);
        }
      });
    };
    keep_asking("/frame.jpg", taken.pictures);
    keep_asking("/shape.bin", taken.shapes);
  }

 private:
  template <class Work>
  void start(Taken& taken, Work work) {
    threads_.emplace_back([&taken, work](const std::stop_token& stop) {
      try {
        work(stop);
      } catch (const std::exception&) {
        taken.failed = true;
      }
    });
  }
  std::list<std::jthread> threads_;
};

struct Turn {
  double p50_us = 0, p99_us = 0;
  long frames = 0, missed = 0;  ///< missed: by the one who measures
  int dropped = 0;
};

Turn look(const std::filesystem::path& folder, double seconds) {
  BlockReader block(folder);
  std::vector<double> us;
  std::uint64_t first = 0, last = 0;
  int dropped_before = 0, dropped = 0;
  const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  while (std::chrono::steady_clock::now() < until) {
    std::this_thread::sleep_for(kLook);
    const auto frame = block.frame();
    if (!frame || frame->number == last) continue;
    last = frame->number;
    dropped = frame->words[kDropped];
    if (first == 0) {
      first = last;
      dropped_before = dropped;
    }
    us.push_back(static_cast<double>(frame->work_us));
  }
  if (us.size() < 100) throw std::runtime_error("finsightd publishes too few frames to measure");
  std::ranges::sort(us);
  const auto at = [&](double share) {
    return us[static_cast<std::size_t>(share * static_cast<double>(us.size() - 1))];
  };
  const auto frames = static_cast<long>(us.size());
  return {at(0.5), at(0.99), frames, static_cast<long>(last - first) + 1 - frames, dropped - dropped_before};
}

double median(std::vector<double> values) {
  std::ranges::sort(values);
  const std::size_t half = values.size() / 2;
  return values.size() % 2 ? values[half] : (values[half - 1] + values[half]) / 2;
}

}  // namespace

json measure_page_cost(const std::filesystem::path& folder, int port, double seconds, int rounds, int browsers) {
  Taken taken;
  std::vector<double> cost_us, unwatched_us, watched_us, unwatched_p50_us, watched_p50_us;
  long frames = 0, missed = 0;
  int dropped = 0, dropped_unwatched = 0;
  const auto turn = [&](bool watched) {
    std::list<Browser> open;
    if (watched) {
      for (int i = 0; i < browsers; ++i) open.emplace_back(port, taken);
    }
    std::this_thread::sleep_for(kSettle);
    const Turn turn = look(folder, seconds);
    frames += turn.frames;
    missed += turn.missed;
    (watched ? dropped : dropped_unwatched) += turn.dropped;
    (watched ? watched_us : unwatched_us).push_back(turn.p99_us);
    (watched ? watched_p50_us : unwatched_p50_us).push_back(turn.p50_us);
  };
  for (int round = 0; round < rounds; ++round) {
    // Which of the two comes first alternates, so that a machine that grows slower counts for neither.
    turn(round % 2 == 1);
    turn(round % 2 == 0);
    cost_us.push_back(watched_us.back() - unwatched_us.back());
  }
  if (taken.failed) throw std::runtime_error("the page did not answer a browser");
  const double watched_s = rounds * (seconds + std::chrono::duration<double>(kSettle).count()) * browsers;
  return {{"loop_cost_us", median(cost_us)},
          {"allowed_us", std::max(kLeast_us, kShare * median(unwatched_us))},
          {"dropped", dropped},
          {"dropped_unwatched", dropped_unwatched},
          {"unwatched_p99_us", median(unwatched_us)},
          {"watched_p99_us", median(watched_us)},
          {"unwatched_p50_us", median(unwatched_p50_us)},
          {"watched_p50_us", median(watched_p50_us)},
          {"cost_us_by_round", cost_us},
          {"browsers", browsers},
          {"frames", frames},
          {"frames_not_seen", missed},
          {"pictures_per_s_and_browser", static_cast<double>(taken.pictures) / watched_s},
          {"shapes_per_s_and_browser", static_cast<double>(taken.shapes) / watched_s}};
}

}  // namespace finsight::host
