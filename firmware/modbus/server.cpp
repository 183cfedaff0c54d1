#include "firmware/modbus/server.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cerrno>
#include <chrono>
#include <system_error>
#include <thread>
#include <tuple>
#include <utility>
#include <vector>

#include "firmware/modbus/request.h"
#include "firmware/modbus/serial_line.h"
#include "firmware/modbus/triple_buffer.h"

namespace finsight {

namespace {

// A frame: transaction id (2 bytes), protocol id (2), length of the rest (2), unit id (1), PDU.
constexpr std::size_t kHeader = 7;
constexpr std::size_t kMaxFrame = kHeader + kMaxPdu;

constexpr std::int64_t kSecond_ns = 1'000'000'000;
constexpr std::int64_t kFrameLimit_ns = 3 * kSecond_ns;  // a client whose frame takes longer to arrive is closed
// A client that has sent no request for so long may lose its place to a newcomer: before its first request, and after.
constexpr std::int64_t kMute_ns = 2 * kSecond_ns, kQuiet_ns = 10 * kSecond_ns;
constexpr std::int64_t kAcceptPause_ns = kSecond_ns / 2;  // after accept() failed for want of descriptors or memory
constexpr int kPollTimeout_ms = 500;                      // clients are closed at most this late
constexpr int kAcceptsPerPoll = 8;

// The kernel's buffers for one client: enough for a hundred requests, yet little memory with 32 hostile clients.
constexpr int kReceiveBuffer_bytes = 16 * 1024;
constexpr int kSendBuffer_bytes = 64 * 1024;

class Descriptor {
 public:
  explicit Descriptor(int fd = -1) : fd_(fd) {}
  ~Descriptor() { close(); }
  Descriptor(Descriptor&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(fd_, other.fd_);  // `other` closes ours
    return *this;
  }
  void close() {
    if (fd_ >= 0) ::close(std::exchange(fd_, -1));
  }
  bool is_open() const { return fd_ >= 0; }
  int get() const { return fd_; }

 private:
  int fd_;
};

struct Client {
  Descriptor socket;
  std::int64_t deadline_ns = 0;  ///< closed if no whole frame arrives before this
  std::int64_t active_ns = 0;    ///< time of its connection or last request
  bool has_asked = false;        ///< has sent a whole request
  std::size_t used = 0;          ///< bytes of `frame` that have arrived
  ClientAccess access;
  std::array<std::uint8_t, kMaxFrame> frame;

  std::size_t length_field() const { return static_cast<std::size_t>(frame[4] << 8 | frame[5]); }
  bool has_valid_header() const {
    const bool is_modbus = frame[2] == 0 && frame[3] == 0;
    return is_modbus && length_field() >= 2 && length_field() <= 1 + kMaxPdu;
  }
  std::size_t wanted() const { return used < kHeader ? kHeader : kHeader - 1 + length_field(); }
};

Descriptor open_listener(const ModbusSettings& settings) {
  const auto require = [&settings](bool done) {
    if (done) return;
    const int error = errno;
    const std::string place = settings.address + ":" + std::to_string(settings.port);
    throw std::system_error(error, std::generic_category(), "Modbus cannot listen on " + place);
  };
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(settings.port));
  const std::optional<Network> own = Network::parse(settings.address);
  errno = EINVAL;
  require(own && own->is_address());
  address.sin_addr.s_addr = htonl(own->address);
  Descriptor listener(::socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  require(listener.is_open());
  // Accepted sockets inherit these options. With SO_REUSEADDR a restarted server gets its port although connections of
  // its predecessor are in TIME_WAIT; two servers still cannot share a port.
  const auto set = [&](int level, int option, int value) {
    require(::setsockopt(listener.get(), level, option, &value, sizeof value) == 0);
  };
  set(SOL_SOCKET, SO_REUSEADDR, 1);
  set(SOL_SOCKET, SO_RCVBUF, kReceiveBuffer_bytes);
  set(SOL_SOCKET, SO_SNDBUF, kSendBuffer_bytes);
  set(IPPROTO_TCP, TCP_NODELAY, 1);
  require(::bind(listener.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0);
  // The longest queue, so that a burst of connections that will be refused does not keep others out.
  require(::listen(listener.get(), SOMAXCONN) == 0);
  return listener;
}

int port_of(const Descriptor& listener) {
  sockaddr_in address{};
  socklen_t size = sizeof address;
  ::getsockname(listener.get(), reinterpret_cast<sockaddr*>(&address), &size);
  return ntohs(address.sin_port);
}

}  // namespace

struct ModbusServer::Impl {
  Impl(const ModbusSettings& wanted, Control& served, const std::function<void(const std::string&)>& report)
      : settings(wanted),
        control(served),
        listener(open_listener(settings)),
        port(port_of(listener)),
        wake(::eventfd(0, EFD_CLOEXEC)),
        idle_limit_ns(settings.idle_limit_s * kSecond_ns),
        clients(static_cast<std::size_t>(settings.max_clients)),
        polled(clients.size() + kFirstClient) {
    if (!wake.is_open()) throw std::system_error(errno, std::generic_category(), "Modbus server");
    if (settings.serial) serial = std::make_unique<SerialLine>(*settings.serial, control, report);
    thread = std::thread([this] { run(); });
  }

  ~Impl() {
    ::eventfd_write(wake.get(), 1);
    thread.join();
  }

  // After each poll every client that has sent something gets one request answered, so that none can hold up another.
  // What it has sent beyond that stays in the kernel's buffer until the next poll.
  void run() {
    for (;;) {
      choose_polled(steady_now_ns());
      const int ready = ::poll(polled.data(), polled.size(), kPollTimeout_ms);
      assert(ready >= 0 || errno == EINTR);  // an interrupted poll leaves all revents 0
      if (polled[kWake].revents) return;
      for (std::size_t i = 0; i < clients.size(); ++i) {
        if (polled[kFirstClient + i].revents && !serve(clients[i])) clients[i].socket.close();
      }
      if (polled[kListener].revents) accept_clients();
    }
  }

  /// Closes the clients that are overdue and lists the others for poll().
  void choose_polled(std::int64_t now_ns) {
    polled[kWake] = {wake.get(), POLLIN, 0};
    polled[kListener] = {now_ns < accept_after_ns ? -1 : listener.get(), POLLIN, 0};
    for (std::size_t i = 0; i < clients.size(); ++i) {
      if (now_ns > clients[i].deadline_ns) clients[i].socket.close();
      polled[kFirstClient + i] = {clients[i].socket.get(), POLLIN, 0};
    }
  }

  void accept_clients() {
    for (int i = 0; i < kAcceptsPerPoll; ++i) {
      sockaddr_in from{};
      socklen_t size = sizeof from;
      Descriptor socket(
          ::accept4(listener.get(), reinterpret_cast<sockaddr*>(&from), &size, SOCK_NONBLOCK | SOCK_CLOEXEC));
      if (!socket.is_open()) {
        // Without descriptors or memory the listener stays readable; without a pause the thread would spin.
        const bool is_transient = errno == EAGAIN || errno == EINTR || errno == ECONNABORTED;
        if (!is_transient) accept_after_ns = steady_now_ns() + kAcceptPause_ns;
        return;
      }
      const std::uint32_t address = ntohl(from.sin_addr.s_addr);
      if (!is_listed(settings.allow, address)) continue;  // closed at once
      const std::int64_t accepted_ns = steady_now_ns();
      Client* const place = place_for_newcomer(accepted_ns);
      if (!place) continue;               // too many clients: closed at once
      place->socket = std::move(socket);  // closes the client that was replaced
      place->used = 0;
      place->access = {.may_write = is_listed(settings.allow_writes, address), .address = address};
      place->deadline_ns = accepted_ns + idle_limit_ns;
      place->active_ns = accepted_ns;
      place->has_asked = false;
    }
  }

  /// A free place, or else that of a client that has been quiet for long: first one that never sent a request, then the
  /// one quiet for longest (Modbus Messaging on TCP/IP V1.0b, section 4.2.1.1: the oldest unused connection is closed).
  /// Null if there is neither.
  Client* place_for_newcomer(std::int64_t time_ns) {
    const auto rank = [](const Client& c) { return std::tuple(c.socket.is_open(), c.has_asked, c.active_ns); };
    Client* place = nullptr;
    for (Client& client : clients) {
      const std::int64_t quiet_ns = time_ns - client.active_ns;
      if (client.socket.is_open() && quiet_ns < (client.has_asked ? kQuiet_ns : kMute_ns)) continue;
      if (!place || rank(client) < rank(*place)) place = &client;
    }
    return place;
  }

  /// Reads the missing bytes of one frame, never more, and answers it once it is whole. False: close the connection.
  bool serve(Client& client) {
    while (client.used < client.wanted()) {
      const ssize_t got = ::recv(client.socket.get(), &client.frame[client.used], client.wanted() - client.used, 0);
      if (got < 0) return errno == EAGAIN || errno == EINTR;
      if (got == 0) return false;
      // The time limit of a frame starts with its first byte and is not extended by further bytes.
      if (client.used == 0) client.deadline_ns = std::min(client.deadline_ns, steady_now_ns() + kFrameLimit_ns);
      client.used += static_cast<std::size_t>(got);
      if (client.used == kHeader && !client.has_valid_header()) return false;
    }
    const bool answered = answer(client);
    client.used = 0;
    client.active_ns = steady_now_ns();
    client.has_asked = true;
    client.deadline_ns = client.active_ns + idle_limit_ns;
    return answered;
  }

  /// Other units do not exist here and get no answer. 0 and 255 address a device that has no units behind its IP
  /// address (Modbus Messaging on TCP/IP V1.0b, section 4.4.2.1).
  bool is_ours(std::uint8_t unit) const {
    if (unit == 0 || unit == 255) return true;
    return settings.unit == 0 ? unit <= 247 : unit == settings.unit;
  }

  /// False: the client does not read its answers. Its connection is then reset, and what it has not read is lost.
  bool answer(Client& client) {
    if (!is_ours(client.frame[kHeader - 1])) return true;
    std::array<std::uint8_t, kMaxFrame> reply;
    const std::size_t length =
        answer_request({&client.frame[kHeader], client.used - kHeader}, view_now(latest, control), client.access,
                       std::span<std::uint8_t, kMaxPdu>(&reply[kHeader], kMaxPdu));
    std::copy_n(client.frame.begin(), kHeader, reply.begin());
    reply[4] = 0;
    reply[5] = static_cast<std::uint8_t>(length + 1);
    const std::size_t total = kHeader + length;
    if (::send(client.socket.get(), reply.data(), total, MSG_NOSIGNAL) == static_cast<ssize_t>(total)) return true;
    const linger abort{1, 0};
    ::setsockopt(client.socket.get(), SOL_SOCKET, SO_LINGER, &abort, sizeof abort);
    return false;
  }

  static constexpr std::size_t kWake = 0, kListener = 1, kFirstClient = 2;
  const ModbusSettings settings;
  Control& control;
  Descriptor listener;
  int port;
  Descriptor wake;
  std::int64_t idle_limit_ns;
  std::vector<Client> clients;
  std::vector<pollfd> polled;
  std::int64_t accept_after_ns = 0;
  TripleBuffer<RegisterImage> latest{empty_block()};
  std::unique_ptr<SerialLine> serial;
  std::thread thread;
};

ModbusServer::ModbusServer(const ModbusSettings& settings, Control& control,
                           const std::function<void(const std::string&)>& report)
    : impl_(std::make_unique<Impl>(settings, control, report)) {}
ModbusServer::~ModbusServer() = default;
void ModbusServer::publish(const RegisterImage& image) noexcept {
  impl_->latest.publish(image);
  if (impl_->serial) impl_->serial->publish(image);
}
int ModbusServer::port() const { return impl_->port; }

}  // namespace finsight
