#include "firmware/modbus/serial_line.h"

#include <doctest/doctest.h>
#include <fcntl.h>
#include <modbus.h>
#include <poll.h>
#include <pty.h>
#include <termios.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <memory>
#include <mutex>
#include <thread>

#include "tests/modbus/raw_client.h"
#include "tests/model/scratch_folder.h"

using namespace finsight;
using namespace finsight::tests;
using namespace std::chrono_literals;

namespace {

/// A pseudo terminal: the firmware opens one end of it as its line, the test uses the other one as the bus.
class Bus {
 public:
  Bus() {
    REQUIRE(::openpty(&bus_, &line_, name_, nullptr, nullptr) == 0);
    termios raw;
    ::tcgetattr(line_, &raw);
    ::cfmakeraw(&raw);
    ::tcsetattr(line_, TCSANOW, &raw);
  }
  ~Bus() { unplug(); }
  const char* device() const { return name_; }
  void unplug() {
    for (int* end : {&bus_, &line_}) {
      if (*end >= 0) ::close(std::exchange(*end, -1));
    }
  }
  void send(const Bytes& bytes) const { REQUIRE(::write(bus_, bytes.data(), bytes.size()) == ssize_t(bytes.size())); }
  /// Bytes until `wanted` have arrived or none has for the time `quiet`.
  Bytes receive(std::size_t wanted, std::chrono::milliseconds quiet = 1000ms) const {
    Bytes bytes;
    pollfd polled{bus_, POLLIN, 0};
    while (bytes.size() < wanted && ::poll(&polled, 1, int(quiet.count())) > 0) {
      std::uint8_t part[256];
      const ssize_t got = ::read(bus_, part, sizeof part);
      if (got <= 0) break;
      bytes.insert(bytes.end(), part, part + got);
    }
    return bytes;
  }
  Bytes ask(const Bytes& request, std::size_t wanted) const {
    send(request);
    return receive(wanted);
  }

 private:
  int bus_ = -1, line_ = -1;
  char name_[64];
};

/// The frame with its checksum, computed bit by bit from the definition in the standard (polynomial 0xA001, reflected).
Bytes sealed(Bytes frame) {
  unsigned crc = 0xFFFF;
  for (const std::uint8_t byte : frame) {
    crc ^= byte;
    for (int i = 0; i < 8; ++i) crc = crc % 2 ? crc / 2 ^ 0xA001U : crc / 2;
  }
  frame.push_back(std::uint8_t(crc % 256));
  frame.push_back(std::uint8_t(crc / 256));
  return frame;
}

/// Collects what the line reports, from its thread.
class Reports {
 public:
  void add(const std::string& text) {
    const std::lock_guard lock(mutex_);
    text_ += text + "\n";
  }
  bool wait_for(const std::string& part) {
    for (int i = 0; i < 500; ++i, std::this_thread::sleep_for(10ms)) {
      const std::lock_guard lock(mutex_);
      if (text_.find(part) != std::string::npos) return true;
    }
    return false;
  }

 private:
  std::mutex mutex_;
  std::string text_;
};

/// Unit 17 on a line of 19200 baud; register i holds 0x1000 + i.
struct Served {
  explicit Served(const std::string& device)
      : line(settings(device), std::array{&control}, empty_block(),
             [this](const std::string& report) { reports.add(report); }) {
    RegisterImage image;
    for (std::size_t i = 0; i < image.words.size(); ++i) image.words[i] = static_cast<std::uint16_t>(0x1000 + i);
    line.publish(image, 0);
  }
  static SerialSettings settings(const std::string& device) {
    SerialSettings settings;
    settings.device = device;
    settings.unit = 17;
    return settings;
  }
  Reports reports;
  Control control;
  SerialLine line;
};

const Bytes kRead = sealed(hex("11 03 0005 0002")), kReply = sealed(hex("11 03 04 1005 1006"));

}  // namespace

TEST_CASE("serial line: the tests' checksum is that of the standard's example") {
  CHECK(sealed(hex("02 07")) == hex("02 07 41 12"));  // Modbus over Serial Line V1.02, section 6.2.2
}

TEST_CASE("serial line: reads, refused requests and identification get their exact bytes") {
  const Bus bus;
  Served served(bus.device());
  REQUIRE(served.reports.wait_for("is open"));
  CHECK(bus.ask(kRead, kReply.size()) == kReply);
  CHECK(bus.ask(sealed(hex("11 04 0054 0001")), 7) == sealed(hex("11 04 02 1054")));
  CHECK(bus.ask(sealed(hex("11 03 0054 0002")), 5) == sealed(hex("11 83 02")));
  CHECK(bus.ask(sealed(hex("11 03 0000 007E")), 5) == sealed(hex("11 83 03")));
  CHECK(bus.ask(sealed(hex("11 06 0001 0003")), 5) == sealed(hex("11 86 02")));
  CHECK(bus.ask(sealed(hex("11 10 0001 0001 02 0003")), 5) == sealed(hex("11 90 02")));
  CHECK(bus.ask(sealed(hex("11 07")), 5) == sealed(hex("11 87 01")));
  CHECK(bus.ask(sealed(hex("11 2B 0E 04 00")), 20) == sealed(hex("11 2B 0E 04 82 00 00 01 00 08 'Finsight'")));
}

TEST_CASE(
    "serial line: after other units' requests, broadcasts, bad checksums and fragments it answers the next request") {
  const Bus bus;
  Served served(bus.device());
  REQUIRE(served.reports.wait_for("is open"));
  Bytes wrong = kRead;
  wrong.back() ^= 1;
  for (const Bytes& unanswered : {sealed(hex("12 03 0005 0002")), sealed(hex("00 03 0005 0002")), wrong, hex("11"),
                                  hex("11 03 00"), Bytes(1000, 0x11), sealed({}), sealed(hex("11"))}) {
    CHECK(bus.ask(unanswered, 1).empty());
    CHECK(bus.ask(kRead, kReply.size()) == kReply);
  }
}

TEST_CASE("serial line: writes are answered, and broadcast writes are carried out without an answer") {
  const Bus bus;
  Served served(bus.device());
  REQUIRE(served.reports.wait_for("is open"));
  const Bytes key = sealed(hex("11 06 03EC 4653"));
  CHECK(bus.ask(sealed(hex("11 06 03F8 0064")), 5) == sealed(hex("11 86 04")));
  CHECK(bus.ask(key, 8) == key);
  CHECK(bus.ask(sealed(hex("11 10 03F2 0002 04 0028 001E")), 8) == sealed(hex("11 10 03F2 0002")));
  CHECK(bus.ask(sealed(hex("11 17 03F2 0001 03F8 0001 02 0065")), 7) == sealed(hex("11 17 02 0028")));
  CHECK(bus.ask(sealed(hex("00 10 03F2 0002 04 0032 0031")), 1).empty());
  CHECK(bus.ask(sealed(hex("00 06 03F8 00C8")), 1).empty());
  CHECK(bus.ask(sealed(hex("00 03 03F2 0001")), 1).empty());
  CHECK(bus.ask(sealed(hex("11 03 03F2 0002")), 9) == sealed(hex("11 03 04 0032 0031")));
  CHECK(bus.ask(sealed(hex("11 03 03F8 0001")), 7) == sealed(hex("11 03 02 00C8")));
}

TEST_CASE("serial line: a request right behind another unit's answer is recognised, and so is one in pieces") {
  const Bus bus;
  Served served(bus.device());
  REQUIRE(served.reports.wait_for("is open"));
  CHECK(bus.ask(sealed(hex("12 03 04 1111 2222")) + kRead, kReply.size()) == kReply);
  bus.send({kRead.begin(), kRead.begin() + 3});
  std::this_thread::sleep_for(3ms);
  CHECK(bus.ask({kRead.begin() + 3, kRead.end()}, kReply.size()) == kReply);
}

TEST_CASE("serial line: a missing device is opened when it appears, and again after it has been unplugged") {
  const test::ScratchFolder folder;
  const auto device = folder.path() / "ttyUSB0";
  Served served(device.string());
  REQUIRE(served.reports.wait_for("cannot be opened (No such file or directory)"));
  for (int i = 0; i < 2; ++i) {
    Bus bus;
    std::filesystem::create_symlink(bus.device(), device);
    Bytes reply;
    for (int tries = 0; tries < 10 && reply.empty(); ++tries) {
      bus.send(kRead);
      reply = bus.receive(kReply.size(), 500ms);
    }
    CHECK(reply.size() >= kReply.size());  // requests that waited in the device are answered, too
    std::filesystem::remove(device);
    bus.unplug();
    CHECK(served.reports.wait_for("was lost"));
  }
}

TEST_CASE("serial line: libmodbus as a master reads the block") {
  const Bus bus;
  Served served(bus.device());
  REQUIRE(served.reports.wait_for("is open"));
  // libmodbus opens a pseudo terminal of its own; a thread carries bytes between the two.
  const Bus other;
  std::atomic<bool> stop{false};
  std::thread wire([&] {
    while (!stop) {
      if (const Bytes bytes = other.receive(1, 5ms); !bytes.empty()) bus.send(bytes);
      if (const Bytes bytes = bus.receive(1, 5ms); !bytes.empty()) other.send(bytes);
    }
  });
  const std::unique_ptr<modbus_t, decltype(&modbus_free)> master(modbus_new_rtu(other.device(), 19200, 'E', 8, 1),
                                                                 &modbus_free);
  modbus_set_slave(master.get(), 17);
  REQUIRE(modbus_connect(master.get()) == 0);
  std::uint16_t words[kMeasurementRegisters] = {};
  CHECK(modbus_read_registers(master.get(), 0, kMeasurementRegisters, words) == kMeasurementRegisters);
  CHECK(words[47] == 0x102F);
  CHECK(modbus_read_input_registers(master.get(), kMeasurementRegisters, 1, words) == -1);
  CHECK(errno == EMBXILADD);
  CHECK(modbus_write_register(master.get(), 0, 1) == -1);
  CHECK(errno == EMBXILADD);
  stop = true;
  wire.join();
}

TEST_CASE("serial line: each finger has a unit of its own, others' stay silent, and a broadcast reaches all") {
  const Bus bus;
  Control first, second;
  Reports reports;
  SerialLine line(Served::settings(bus.device()), std::array{&first, &second}, empty_block(),
                  [&](const std::string& report) { reports.add(report); });
  for (std::size_t finger = 0; finger < 2; ++finger) {
    RegisterImage image;
    image.words[5] = static_cast<std::uint16_t>(0x1000 + finger);
    line.publish(image, finger);
  }
  REQUIRE(reports.wait_for("is open"));
  CHECK(bus.ask(sealed(hex("11 03 0005 0001")), 7) == sealed(hex("11 03 02 1000")));
  CHECK(bus.ask(sealed(hex("12 03 0005 0001")), 7) == sealed(hex("12 03 02 1001")));
  CHECK(bus.ask(sealed(hex("12 03 07D0 0001")), 7) == sealed(hex("12 03 02 0002")));  // two fingers
  CHECK(bus.ask(sealed(hex("13 03 0005 0001")), 7).empty());
  CHECK(bus.ask(sealed(hex("00 06 03EC 4653")), 1).empty());  // the key, to all
  CHECK(bus.ask(sealed(hex("00 06 03F8 004D")), 1).empty());  // hold_time 77
  for (const char* unit : {"11", "12"}) {
    CHECK(bus.ask(sealed(hex(std::string(unit) + " 03 03F8 0001")), 7) ==
          sealed(hex(std::string(unit) + " 03 02 004D")));
  }
}
