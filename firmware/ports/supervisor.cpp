#include "firmware/ports/supervisor.h"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstddef>
#include <cstdlib>
#include <cstring>

#include "firmware/types.h"

namespace finsight {

Supervisor::Supervisor(std::size_t fingers) : all_((1U << fingers) - 1) {
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

void Supervisor::alive(std::int64_t now_ns, bool is_measuring, std::size_t finger) {
  const unsigned bit = 1U << finger;
  is_measuring ? measuring_ |= bit : measuring_ &= ~bit;
  const bool all_measure = measuring_ == all_;
  send_once_per_second(now_ns, finger,
                       all_measure ? "WATCHDOG=1\nSTATUS=measuring" : "WATCHDOG=1\nSTATUS=looking for the camera");
}

void Supervisor::alive_without_sensor(std::int64_t now_ns, std::size_t finger) {
  send_once_per_second(now_ns, finger, "WATCHDOG=1");
}

void Supervisor::send_once_per_second(std::int64_t now_ns, std::size_t finger, const char* message) {
  alive_ |= 1U << finger;
  if (alive_ != all_ || now_ns - last_alive_ns_ < kNsPerS) return;  // the supervisor need not hear of every frame
  last_alive_ns_ = now_ns;
  alive_ = 0;
  send(message);
}

void Supervisor::send(const char* message) const {
  if (socket_ >= 0) ::send(socket_, message, std::strlen(message), MSG_DONTWAIT | MSG_NOSIGNAL);
}

}  // namespace finsight
