#include "firmware/appliance.h"

#include <arpa/inet.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <stdexcept>

namespace finsight {

namespace {

void require(int result, const std::string& what) {
  if (result != 0) throw std::runtime_error(what + ": " + std::strerror(errno));
}

}  // namespace

void make_realtime(const RealtimeSettings& settings) {
  if (settings.lock_memory) require(mlockall(MCL_CURRENT | MCL_FUTURE), "realtime.lock_memory");
  if (settings.cpu >= 0) {
    cpu_set_t cpus;
    CPU_ZERO(&cpus);
    CPU_SET(settings.cpu, &cpus);
    require(sched_setaffinity(0, sizeof cpus, &cpus), "realtime.cpu = " + std::to_string(settings.cpu));
  }
  if (settings.priority > 0) {
    // Threads that libraries start for themselves stay ordinary ones.
    const sched_param parameters{.sched_priority = settings.priority};
    require(sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &parameters),
            "realtime.priority = " + std::to_string(settings.priority));
  }
}

OrdinaryThread::OrdinaryThread() {
  CPU_ZERO(&cpus_);
  sched_getaffinity(0, sizeof cpus_, &cpus_);
}

void OrdinaryThread::restore() const {
  sched_setaffinity(0, sizeof cpus_, &cpus_);
  const sched_param parameters{};
  sched_setscheduler(0, SCHED_OTHER | SCHED_RESET_ON_FORK, &parameters);
}

bool is_ipv4(const std::string& text, bool with_prefix) {
  if (text.find('\0') != std::string::npos) return false;  // inet_pton would not see what follows
  const std::size_t slash = text.find('/');
  if ((slash != std::string::npos) != with_prefix) return false;
  if (with_prefix) {
    int prefix = 0;
    const char* end = text.data() + text.size();
    const auto [rest, error] = std::from_chars(text.data() + slash + 1, end, prefix);
    if (error != std::errc() || rest != end || prefix < 1 || prefix > 32) return false;
  }
  in_addr address{};
  return inet_pton(AF_INET, text.substr(0, slash).c_str(), &address) == 1;
}

std::string networkd_file(const NetworkSettings& settings) {
  std::string text = "[Match]\nType=ether\n[Network]\nLinkLocalAddressing=no\nIPv6AcceptRA=no\n";
  if (settings.address.empty()) {
    text += "DHCP=ipv4\n[DHCPv4]\nUseDNS=no\nUseNTP=no\nUseHostname=no\n";
  } else {
    text += "Address=" + settings.address + "\n";
    if (!settings.gateway.empty()) text += "Gateway=" + settings.gateway + "\n";
  }
  return text;
}

Supervisor::Supervisor() {
  const char* name = std::getenv("NOTIFY_SOCKET");
  sockaddr_un address{};
  if (!name || std::strlen(name) >= sizeof address.sun_path) return;
  address.sun_family = AF_UNIX;
  std::strcpy(address.sun_path, name);
  if (name[0] == '@') address.sun_path[0] = '\0';  // an abstract socket
  const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + std::strlen(name));
  socket_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (socket_ >= 0 && connect(socket_, reinterpret_cast<const sockaddr*>(&address), length) != 0) {
    close(socket_);
    socket_ = -1;
  }
}

Supervisor::~Supervisor() {
  if (socket_ >= 0) close(socket_);
}

void Supervisor::ready() const { send("READY=1"); }

void Supervisor::alive(std::int64_t now_ns, bool is_measuring) {
  constexpr std::int64_t kBetween_ns = 1'000'000'000;
  if (now_ns - last_alive_ns_ < kBetween_ns) return;
  last_alive_ns_ = now_ns;
  send(is_measuring ? "WATCHDOG=1\nSTATUS=measuring" : "WATCHDOG=1\nSTATUS=looking for the camera");
}

void Supervisor::send(const char* message) const {
  if (socket_ >= 0) ::send(socket_, message, std::strlen(message), MSG_DONTWAIT | MSG_NOSIGNAL);
}

}  // namespace finsight
