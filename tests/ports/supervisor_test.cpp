#include "firmware/ports/supervisor.h"

#include <doctest/doctest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <string>

#include "tests/model/scratch_folder.h"

using namespace finsight;

namespace {

/// The receiving end of a notification socket, named in the environment as systemd does.
struct NotifySocket {
  explicit NotifySocket(const std::filesystem::path& path) : socket(::socket(AF_UNIX, SOCK_DGRAM, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path.string().copy(address.sun_path, sizeof address.sun_path - 1);
    REQUIRE(bind(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0);
    setenv("NOTIFY_SOCKET", path.c_str(), 1);
  }
  ~NotifySocket() {
    unsetenv("NOTIFY_SOCKET");
    close(socket);
  }
  std::string next() const {
    char text[64];
    const ssize_t length = recv(socket, text, sizeof text, MSG_DONTWAIT);
    return length > 0 ? std::string(text, static_cast<std::size_t>(length)) : "";
  }
  int socket;
};

}  // namespace

TEST_CASE("supervisor: systemd is notified of the start, and at most once per second that the loop runs") {
  const test::ScratchFolder folder;
  const NotifySocket systemd(folder / "notify");
  Supervisor supervisor;
  supervisor.ready();
  CHECK(systemd.next() == "READY=1");
  constexpr std::int64_t kSecond = 1'000'000'000;
  supervisor.alive(5 * kSecond, true);
  supervisor.alive(5 * kSecond + 1, true);
  supervisor.alive(6 * kSecond - 1, false);
  CHECK(systemd.next() == "WATCHDOG=1\nSTATUS=measuring");
  CHECK(systemd.next() == "");
  supervisor.alive(6 * kSecond, false);
  CHECK(systemd.next() == "WATCHDOG=1\nSTATUS=looking for the camera");
  supervisor.alive_without_sensor(7 * kSecond);
  CHECK(systemd.next() == "WATCHDOG=1");
}

TEST_CASE("supervisor: a finger that gives no sign of life is not covered up by the other one") {
  const test::ScratchFolder folder;
  const NotifySocket systemd(folder / "notify");
  Supervisor supervisor(2);
  constexpr std::int64_t kSecond = 1'000'000'000;
  for (int second = 1; second < 5; ++second) supervisor.alive_without_sensor(second * kSecond, 1);
  CHECK(systemd.next() == "");
  supervisor.alive_without_sensor(5 * kSecond, 0);
  CHECK(systemd.next() == "WATCHDOG=1");
  supervisor.alive_without_sensor(6 * kSecond, 0);
  CHECK(systemd.next() == "");
}

TEST_CASE("supervisor: without a socket, or with one that nobody reads, nothing happens") {
  Supervisor alone;
  alone.ready();
  setenv("NOTIFY_SOCKET", "/nowhere/at/all", 1);
  Supervisor deaf;
  deaf.alive(1'000'000'000'000, true);
  setenv("NOTIFY_SOCKET", std::string(200, 'x').c_str(), 1);
  Supervisor too_long;
  too_long.ready();
  unsetenv("NOTIFY_SOCKET");
}
