#include "firmware/modbus/server.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sched.h>
#include <sys/eventfd.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cerrno>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "firmware/modbus/client_places.h"
#include "firmware/modbus/descriptor.h"
#include "firmware/modbus/request.h"
#include "firmware/modbus/serial_line.h"
#include "firmware/modbus/tcp_client.h"

namespace finsight {

namespace {

constexpr std::int64_t kAcceptPause_ns = kNsPerS / 2;  // after accept() failed for want of descriptors or memory
constexpr std::int64_t kPollTimeout_ns = kNsPerS / 2;  // clients are closed at most this late
constexpr int kAcceptsPerPoll = 2;                     // the bound of what a flood of newcomers adds to a client's wait
constexpr int kNice = -5;
constexpr std::uint64_t kSlice_ns = 100'000;  // the shortest that Linux gives

/// struct sched_attr of sched_setattr(2), which the C library does not declare.
struct SchedulingAttributes {
  std::uint32_t size = sizeof(SchedulingAttributes), policy = SCHED_OTHER;
  std::uint64_t flags = 0;
  std::int32_t nice = 0;
  std::uint32_t priority = 0;
  std::uint64_t runtime_ns = 0, deadline_ns = 0, period_ns = 0;
};

// The kernel's buffers for one client: enough for a hundred requests, yet little memory with 64 hostile clients.
constexpr int kReceiveBuffer_bytes = 16 * 1024;
constexpr int kSendBuffer_bytes = 64 * 1024;

/// After the frame loop, and before whatever else runs, where the system allows it; and with a short time slice (Linux
/// 6.12 and later), so that this thread, which works for microseconds, need not wait for others' slices of
/// milliseconds. Both are a thread's own on Linux.
void prefer_this_thread() {
  const int nice = std::min(::getpriority(PRIO_PROCESS, 0), kNice);
  ::setpriority(PRIO_PROCESS, 0, nice);
  SchedulingAttributes attributes;
  attributes.nice = ::getpriority(PRIO_PROCESS, 0);
  attributes.runtime_ns = kSlice_ns;
  ::syscall(SYS_sched_setattr, 0, &attributes, 0U);
}

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
  Impl(const ModbusSettings& wanted, std::span<Control* const> controls,
       const std::function<void(const std::string&)>& report, const RegisterImage& first)
      : settings(wanted),
        fingers(controls, first),
        listener(open_listener(settings)),
        port(port_of(listener)),
        wake(::eventfd(0, EFD_CLOEXEC)),
        places(static_cast<std::size_t>(settings.max_clients), static_cast<std::size_t>(settings.most_per_address()),
               settings.reserve),
        clients(places.size()),
        polled(clients.size() + kFirstClient) {
    if (!wake.is_open()) throw std::system_error(errno, std::generic_category(), "Modbus server");
    if (settings.serial) serial = std::make_unique<SerialLine>(*settings.serial, controls, first, report);
    thread = std::thread([this] { run(); });
  }

  ~Impl() {
    ::eventfd_write(wake.get(), 1);
    thread.join();
  }

  // In each round every client that has sent something gets one request answered, and then at most two newcomers are
  // let in or refused, so that none can hold up another. What a client has sent beyond that stays in its buffers.
  void run() {
    prefer_this_thread();
    for (;;) {
      const std::int64_t now_ns = steady_now_ns();
      const timespec timeout = duration(choose_polled(now_ns) - now_ns);
      const int ready = ::ppoll(polled.data(), polled.size(), &timeout, nullptr);
      assert(ready >= 0 || errno == EINTR);  // an interrupted poll leaves all revents 0
      if (polled[kWake].revents) return;
      for (std::size_t i = 0; i < clients.size(); ++i) {
        if (is_due[i] || polled[kFirstClient + i].revents) serve(i);
      }
      if (polled[kListener].revents) accept_clients();
    }
  }

  static timespec duration(std::int64_t ns) { return {.tv_sec = ns / kNsPerS, .tv_nsec = ns % kNsPerS}; }

  /// Closes the clients that are overdue and lists the others for poll(). Returns the time to wait for.
  std::int64_t choose_polled(std::int64_t now_ns) {
    std::int64_t until_ns = now_ns + kPollTimeout_ns;
    polled[kWake] = {wake.get(), POLLIN, 0};
    polled[kListener] = {now_ns < accept_after_ns ? -1 : listener.get(), POLLIN, 0};
    for (std::size_t i = 0; i < clients.size(); ++i) {
      const TcpClient& client = clients[i];
      if (client.is_open() && now_ns > client.deadline_ns()) close(i);
      pollfd& poll = polled[kFirstClient + i] = {client.fd(), POLLIN, 0};
      is_due[i] = false;
      if (!client.is_open()) continue;
      if (client.has_unsent()) {
        poll.events = POLLOUT;
      } else if (client.has_request()) {
        poll.fd = -1;
        is_due[i] = now_ns >= client.turn_ns();
        until_ns = std::min(until_ns, std::max(client.turn_ns(), now_ns));
      }
    }
    return until_ns;
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
      let_in(std::move(socket), ntohl(from.sin_addr.s_addr), steady_now_ns());
    }
  }

  /// Those that are refused are closed at once.
  void let_in(Descriptor socket, std::uint32_t address, std::int64_t now_ns) {
    const bool is_allowed = is_listed(settings.allow, address);
    const std::optional<std::size_t> place = is_allowed ? places.place_for(address, now_ns) : std::nullopt;
    if (!place) return count_connection(Control::Arrival::kRefused);
    const bool is_replacing = places[*place].is_open;
    if (is_replacing) close(*place);
    const ClientAccess access{
        .may_write = is_listed(settings.allow_writes, address), .address = address, .connection = next_connection++};
    clients[*place] = TcpClient(std::move(socket), access, settings.idle_limit_s * kNsPerS, now_ns);
    places[*place] = {.is_open = true, .address = address, .has_asked = false, .active_ns = now_ns};
    count_connection(is_replacing ? Control::Arrival::kReplacing : Control::Arrival::kAccepted);
    show_open_connections();
  }

  // Connections are the device's: every finger tells of them.
  void count_connection(Control::Arrival arrival) {
    for (std::size_t i = 0; i < fingers.count(); ++i) fingers.control(i).count_connection(arrival);
  }
  void show_open_connections() {
    const auto open = static_cast<std::uint32_t>(places.open());
    for (std::size_t i = 0; i < fingers.count(); ++i) fingers.control(i).show_open_connections(open);
  }

  void close(std::size_t place) {
    TcpClient& client = clients[place];
    if (client.has_unsent()) client.abort();  // what it has not taken is lost
    client = TcpClient();
    places[place].is_open = false;
    show_open_connections();
  }

  void serve(std::size_t place) {
    TcpClient& client = clients[place];
    const std::int64_t now_ns = steady_now_ns();
    const TcpClient::Progress progress = client.advance(now_ns);
    if (progress == TcpClient::Progress::kNone) return;
    if (progress == TcpClient::Progress::kEnd || !answer(place, now_ns)) return close(place);
    places[place].active_ns = now_ns;
    places[place].has_asked = true;
  }

  /// 0 and 255 address a device that has no units behind its IP address (Modbus Messaging on TCP/IP V1.0b, section
  /// 4.4.2.1): the first finger. Nothing: no finger has this unit id.
  std::optional<std::size_t> finger_of(std::uint8_t unit) const {
    if (unit == 0 || unit == 255) return 0;
    if (settings.unit == 0 && fingers.count() == 1) return unit <= 247 ? std::optional<std::size_t>(0) : std::nullopt;
    const int finger = unit - std::max(settings.unit, 1);
    if (finger < 0 || finger >= static_cast<int>(fingers.count())) return std::nullopt;
    return static_cast<std::size_t>(finger);
  }

  /// The response's length. One finger alone gives other units no answer (0), as they do not exist here; a device of
  /// several says so, like a gateway, because its client has miscounted.
  std::size_t answer_unit(std::span<const std::uint8_t> request, std::uint8_t unit, const ClientAccess& access,
                          std::span<std::uint8_t, kMaxPdu> reply) {
    if (const auto finger = finger_of(unit)) return answer_request(request, fingers.view(*finger), access, reply);
    if (fingers.count() == 1) return 0;
    reply[0] = request[0] | 0x80;
    reply[1] = static_cast<std::uint8_t>(Exception::kNoSuchFinger);
    return 2;
  }

  /// False: the connection is broken.
  bool answer(std::size_t place, std::int64_t now_ns) {
    constexpr std::size_t kHeader = TcpClient::kHeader;
    TcpClient& client = clients[place];
    const auto request = client.request();
    const std::size_t sharers = places.held_by(client.access().address);
    std::array<std::uint8_t, TcpClient::kMaxFrame> reply;
    const std::size_t length = answer_unit(request.subspan(kHeader), request[kHeader - 1], client.access(),
                                           std::span<std::uint8_t, kMaxPdu>(&reply[kHeader], kMaxPdu));
    if (length == 0) return client.answer({}, sharers, now_ns);
    std::copy_n(request.begin(), kHeader, reply.begin());
    reply[4] = static_cast<std::uint8_t>((length + 1) >> 8);
    reply[5] = static_cast<std::uint8_t>(length + 1);
    return client.answer({reply.data(), kHeader + length}, sharers, now_ns);
  }

  static constexpr std::size_t kWake = 0, kListener = 1, kFirstClient = 2;
  const ModbusSettings settings;
  ServedFingers fingers;
  Descriptor listener;
  int port;
  Descriptor wake;
  ClientPlaces places;
  std::vector<TcpClient> clients;
  std::array<bool, ModbusSettings::kMostClients> is_due{};
  std::vector<pollfd> polled;
  std::uint64_t next_connection = 1;
  std::int64_t accept_after_ns = 0;
  std::unique_ptr<SerialLine> serial;
  std::thread thread;
};

ModbusServer::ModbusServer(const ModbusSettings& settings, std::span<Control* const> controls,
                           const std::function<void(const std::string&)>& report, const RegisterImage& first)
    : impl_(std::make_unique<Impl>(settings, controls, report, first)) {}
ModbusServer::ModbusServer(const ModbusSettings& settings, Control& control,
                           const std::function<void(const std::string&)>& report)
    : ModbusServer(settings, std::array{&control}, report) {}
ModbusServer::~ModbusServer() = default;
void ModbusServer::publish(const RegisterImage& image, std::size_t finger) noexcept {
  impl_->fingers.control(finger).note_publication(steady_now_ns());
  impl_->fingers.publish(finger, image);
  if (impl_->serial) impl_->serial->publish(image, finger);
}
int ModbusServer::port() const { return impl_->port; }

}  // namespace finsight
