#include "firmware/device/realtime.h"
#include "firmware/device/network_file.h"
#include "firmware/device/supervisor.h"

#include <doctest/doctest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "firmware/input_error.h"
#include "firmware/settings/settings.h"
#include "firmware/settings/toml_table.h"

namespace {

using namespace finsight;

/// A folder of the test's own that goes with it.
struct Folder {
  Folder() : path(std::filesystem::temp_directory_path() / ("appliance-test-" + std::to_string(getpid()))) {
    std::filesystem::create_directories(path);
  }
  ~Folder() { std::filesystem::remove_all(path); }
  std::filesystem::path write(const std::string& name, const std::string& text) const {
    std::ofstream(path / name) << text;
    return path / name;
  }
  std::filesystem::path path;
};

constexpr const char* kBoard =
    "pack = \"model.safetensors\"\n[source]\nkind = \"session\"\npath = \"/recorded\"\nrepeat = true\n[modbus]\nport = "
    "502\n";

/// What is said about a board file that is good and a user's file that is not.
std::string refusal(const std::string& user) {
  const Folder folder;
  const auto board = folder.write("board.toml", kBoard);
  try {
    read_settings(board, folder.write("user.toml", user));
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

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

TEST_CASE("appliance: an address is dotted decimal, with or without its prefix length") {
  CHECK(is_ipv4("192.168.0.40/24", true));
  CHECK(is_ipv4("10.0.0.1", false));
  for (const char* wrong : {"192.168.0.40", "192.168.0.40/", "192.168.0.40/0", "192.168.0.40/33", "192.168.0.40/24x",
                            "192.168.0/24", "256.0.0.1/8", "/24", "a.b.c.d/24", "1.2.3.4/24\nGateway=6.6.6.6"}) {
    CAPTURE(wrong);
    CHECK_FALSE(is_ipv4(wrong, true));
  }
  CHECK_FALSE(is_ipv4(std::string("10.0.0.1\0\nDHCP=yes", 18), false));
  CHECK_FALSE(is_ipv4("10.0.0.1/8", false));
  CHECK_FALSE(is_ipv4("", false));
}

TEST_CASE("appliance: the network file asks DHCP, or has the address and the gateway") {
  CHECK(networkd_file({}).find("DHCP=ipv4\n") != std::string::npos);
  const std::string fixed = networkd_file({"192.168.0.40/24", "192.168.0.1"});
  CHECK(fixed.find("Address=192.168.0.40/24\nGateway=192.168.0.1\n") != std::string::npos);
  CHECK(fixed.find("DHCP") == std::string::npos);
  CHECK(networkd_file({"192.168.0.40/24", ""}).find("Gateway") == std::string::npos);
}

TEST_CASE("appliance: the supervisor is told, and the watchdog at most once per second") {
  const Folder folder;
  const NotifySocket systemd(folder.path / "notify");
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
}

TEST_CASE("appliance: without a supervisor, and with one that does not listen, nothing happens") {
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

TEST_CASE("appliance: the user's values take the board file's place, and paths start at the user's file") {
  const Folder folder;
  const auto board = folder.write("board.toml", kBoard);
  std::filesystem::create_directories(folder.path / "esp");
  const auto user = folder.write("esp/user.toml",
                                 "pack = \"finger.safetensors\"\n[modbus]\nword_order = \"CDAB\"\n"
                                 "[network]\nmethod = \"static\"\naddress = \"10.1.2.3/8\"\n");
  const Settings settings = read_settings(board, user);
  CHECK(settings.pack == folder.path / "esp" / "finger.safetensors");
  CHECK(settings.loop.runtime[kWordOrder] == 1);
  CHECK(settings.modbus.port == 502);
  CHECK(settings.replay.path == "/recorded");
  CHECK(settings.network.address == "10.1.2.3/8");
  CHECK(read_settings(board).pack == folder.path / "model.safetensors");
}

TEST_CASE("appliance: a source of another kind replaces the board's as a whole") {
  const Folder folder;
  const auto board = folder.write("board.toml", kBoard);
  const Settings settings =
      read_settings(board, folder.write("user.toml", "[source]\nkind = \"poses\"\npath = \"a.csv\"\n"));
  CHECK(settings.source == Settings::Source::kPoses);
  CHECK_FALSE(settings.replay.repeat);
}

TEST_CASE("appliance: an error in the user's file names that file and line") {
  CHECK(refusal("") == "");
  CHECK(refusal("\n\n[modbsu]\nport = 1\n").find("user.toml:3") != std::string::npos);
  CHECK(refusal("[modbus]\nport = 70000\n").find("user.toml:2") != std::string::npos);
  CHECK(refusal("[modbus]\n\nprot = 502\n").find("user.toml:3") != std::string::npos);
  CHECK(refusal("[network]\nmethod = \"static\"\n").find("network.address") != std::string::npos);
  CHECK(refusal("[network]\nmethod = \"static\"\naddress = \"10.0.0.1\"\n").find("prefix length") != std::string::npos);
  CHECK(refusal("[network]\nmethod = \"dhcp\"\naddress = \"10.0.0.1/8\"\n").find("user.toml:3") != std::string::npos);
  CHECK(refusal("[realtime]\npriority = 99\n").find("user.toml:2") != std::string::npos);
  CHECK(refusal("this is not TOML").find("user.toml:1") != std::string::npos);
}

TEST_CASE("appliance: the network is read however the rest is") {
  const Folder folder;
  const auto board = folder.write("board.toml", kBoard);
  const auto user = folder.write("user.toml",
                                 "[modbus]\nword_order = \"XX\"\n[modbsu]\n"
                                 "[network]\nmethod = \"static\"\naddress = \"10.1.2.3/8\"\n");
  CHECK_THROWS_AS(read_settings(board, user), InputError);
  CHECK(read_network_settings(board, user).address == "10.1.2.3/8");
  CHECK(read_network_settings(board).address.empty());
  const auto wrong = folder.write("wrong.toml", "[network]\nmethod = \"static\"\naddress = \"10.1.2\"\n");
  CHECK_THROWS_WITH_AS(read_network_settings(board, wrong), doctest::Contains("network.address"), InputError);
}

TEST_CASE("appliance: of bad settings the good parts serve the fault") {
  const Folder folder;
  std::string with_outputs = kBoard;
  with_outputs += "[gpio]\nchip = \"/dev/gpiochip0\"\n[gpio.healthy]\nnumber = 3\n";
  const auto board = folder.write("board.toml", with_outputs);
  const auto good_part = folder.write("a.toml", "[modbus]\nport = 1502\nword_order = \"CDAB\"\n[nonsense]\n");
  CHECK(read_good_parts(board, good_part).modbus.port == 1502);
  CHECK(read_good_parts(board, good_part).loop.runtime[kWordOrder] == 1);
  CHECK(read_good_parts(board, good_part).gpio.has_value());
  const auto bad_part = folder.write("b.toml", "[modbus]\nport = 70000\n[gpio]\nchip = 3\n");
  CHECK(read_good_parts(board, bad_part).modbus.port == 502);
  CHECK(read_good_parts(board, bad_part).gpio->chip == "/dev/gpiochip0");
  const auto no_toml = folder.write("c.toml", "port = = 1\n");
  CHECK(read_good_parts(no_toml, no_toml).modbus.address == "0.0.0.0");
  CHECK_FALSE(read_good_parts(folder.path / "none.toml").gpio.has_value());
}
