// A TCP client that sends arbitrary bytes, for tests of the Modbus server.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace finsight::tests {

using Bytes = std::vector<std::uint8_t>;

/// Hexadecimal digits ("0001 0000 0006") as bytes; 'text' in single quotes stands for its characters.
inline Bytes hex(const std::string& text) {
  Bytes bytes;
  int digits = 0, value = 0;
  bool quoted = false;
  for (const char c : text) {
    if (c == '\'') {
      quoted = !quoted;
    } else if (quoted) {
      bytes.push_back(static_cast<std::uint8_t>(c));
    } else if (c != ' ') {
      value = value * 16 + (c <= '9' ? c - '0' : c - 'A' + 10);
      if (++digits % 2 == 0) bytes.push_back(static_cast<std::uint8_t>(std::exchange(value, 0)));
    }
  }
  return bytes;
}

inline Bytes operator+(Bytes a, const Bytes& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

/// A plain TCP connection. Its waits are bounded so that a broken server makes a test fail instead of hanging it.
class Connection {
 public:
  explicit Connection(int port, int receive_buffer = 0, const char* from = nullptr)
      : fd_(::socket(AF_INET, SOCK_STREAM, 0)) {
    const timeval wait{20, 0};
    const int on = 1;
    ::setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &wait, sizeof wait);
    ::setsockopt(fd_, SOL_SOCKET, SO_SNDTIMEO, &wait, sizeof wait);
    ::setsockopt(fd_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    if (receive_buffer) ::setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &receive_buffer, sizeof receive_buffer);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    if (from && ::inet_pton(AF_INET, from, &address.sin_addr) == 1) {
      ::bind(fd_, reinterpret_cast<sockaddr*>(&address), sizeof address);
    }
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (::connect(fd_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) close();
  }
  ~Connection() { close(); }
  Connection(Connection&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Connection& operator=(Connection&&) = delete;

  bool is_open() const { return fd_ >= 0; }
  bool send(const Bytes& bytes) {
    return ::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(bytes.size());
  }
  /// Up to `count` bytes; fewer if the server closes the connection or stays silent.
  Bytes receive(std::size_t count) {
    Bytes bytes(count);
    std::size_t used = 0;
    while (used < count) {
      const ssize_t got = ::recv(fd_, &bytes[used], count - used, 0);
      if (got <= 0) break;
      used += static_cast<std::size_t>(got);
    }
    bytes.resize(used);
    return bytes;
  }
  Bytes ask(const Bytes& request, std::size_t reply_length) { return send(request) ? receive(reply_length) : Bytes{}; }
  /// Waits until the server closes the connection; false if it sends something or does nothing instead.
  bool is_closed_by_server() {
    std::uint8_t byte;
    const ssize_t got = ::recv(fd_, &byte, 1, 0);
    return got == 0 || (got < 0 && errno == ECONNRESET);
  }
  /// Resets the connection; data on its way is dropped.
  void reset() {
    const linger abort{1, 0};
    ::setsockopt(fd_, SOL_SOCKET, SO_LINGER, &abort, sizeof abort);
    close();
  }
  void close() {
    if (fd_ >= 0) ::close(std::exchange(fd_, -1));
  }
  int fd() const { return fd_; }

 private:
  int fd_;
};

}  // namespace finsight::tests
