#include "firmware/modbus/control.h"

#include <doctest/doctest.h>

#include <atomic>
#include <thread>
#include <vector>

#include "firmware/modbus/network.h"

using namespace finsight;

namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

struct Client {
  explicit Client(Control& shared, std::uint32_t address = 1) : control(shared), access{true, address} {}
  Exception write(int first, const std::vector<std::uint16_t>& words, std::int64_t now_ns = 0) {
    return control.write(first, words, access, now_ns);
  }
  std::uint16_t read(int address, std::int64_t now_ns = 0) {
    std::uint16_t word = 0;
    control.read(address, {&word, 1}, access, now_ns);
    return word;
  }
  Control& control;
  ClientAccess access;
};

}  // namespace

TEST_CASE("control: the key unlocks for 30 seconds, and every write for another 30") {
  Control control(4711);
  Client client(control);
  CHECK(client.write(1016, {100}) == Exception::kLocked);
  CHECK(client.write(1004, {4711}) == Exception::kNone);
  CHECK(client.write(1016, {100}, 29 * kSecond) == Exception::kNone);
  CHECK(client.read(1004, 29 * kSecond) == 30);
  CHECK(client.write(1006, {1}, 58 * kSecond) == Exception::kNone);
  CHECK(client.write(1016, {101}, 87 * kSecond) == Exception::kNone);
  CHECK(client.write(1016, {102}, 117 * kSecond) == Exception::kLocked);
  CHECK(client.read(1004, 118 * kSecond) == 0);
  CHECK(client.read(1016) == 101);
}

TEST_CASE("control: 16 clients can be unlocked at once; one more replaces the one whose unlock ends first") {
  Control control;
  for (std::uint32_t n = 1; n <= 17; ++n)
    CHECK(Client(control, n).write(1004, {kDefaultWriteKey}, n) == Exception::kNone);
  CHECK(Client(control, 1).write(1016, {100}, 18) == Exception::kLocked);
  for (std::uint32_t n = 2; n <= 17; ++n) CHECK(Client(control, n).write(1016, {100}, 18) == Exception::kNone);
}

TEST_CASE("control: settings written together are checked together, and an invalid set changes nothing") {
  Control control;
  Client client(control);
  client.write(1004, {kDefaultWriteKey});
  CHECK(client.write(1010, {9, 8}) == Exception::kNone);  // written one by one, "on" would be below "off" in between
  CHECK(client.write(1010, {50, 60}) == Exception::kIllegalValue);
  CHECK(client.write(1012, {300, 250, 1500, 1600}) == Exception::kIllegalValue);
  CHECK(client.read(1012) == 200);
  CHECK(control.settings()[kContactOn] == 9);
  CHECK(control.settings()[kGentleOn] == 200);
}

TEST_CASE("control: command and number are written together or not at all") {
  Control control;
  Client client(control);
  client.write(1004, {kDefaultWriteKey});
  CHECK(client.write(1000, {7}) == Exception::kIllegalAddress);
  CHECK(client.write(1001, {1}) == Exception::kIllegalAddress);
  CHECK(client.write(1000, {99, 2}) == Exception::kIllegalValue);
  CHECK(client.write(1000, {2, 0}) == Exception::kIllegalValue);  // 0 means that there is none
  CHECK_FALSE(control.take_command());
  CHECK(client.read(1000) == 0);
  CHECK(client.write(1000, {2, 1}) == Exception::kNone);
  CHECK(control.take_command() == Command::kSave);
  CHECK(client.read(1002) == 0);
  control.finish(CommandResult::kFailed);
  CHECK(client.read(1000) == 2);
  CHECK(client.read(1001) == 1);
  CHECK(client.read(1002) == 1);
  CHECK(client.read(1003) == 3);
}

TEST_CASE("control: while one client's command runs, the other client's writes get busy") {
  Control control;
  Client first(control, 1), second(control, 2);
  first.write(1004, {kDefaultWriteKey});
  CHECK(first.write(1000, {1, 5}) == Exception::kNone);
  CHECK(second.write(1004, {kDefaultWriteKey}) == Exception::kNone);
  CHECK(second.write(1000, {1, 6}) == Exception::kBusy);
  CHECK(second.write(1016, {5}) == Exception::kBusy);
  CHECK(second.write(1006, {5}) == Exception::kNone);
  CHECK(control.take_command() == Command::kZero);
  CHECK(second.write(1000, {1, 6}) == Exception::kBusy);
  control.finish(CommandResult::kDone);
  CHECK(second.write(1000, {1, 6}) == Exception::kNone);
}

TEST_CASE("control: an exclusive writer is shown, and others are busy until it ends or its unlock does") {
  Control control;
  Client plc(control, 0xC0A80007), other(control, 2);
  plc.write(1004, {kDefaultWriteKey});
  other.write(1004, {kDefaultWriteKey});
  CHECK(plc.write(1009, {2}) == Exception::kIllegalValue);
  CHECK(plc.write(1009, {1}) == Exception::kNone);
  CHECK(other.read(1009) == 1);
  CHECK(other.read(1206) == 0xC0A8);
  CHECK(other.read(1207) == 0x0007);
  CHECK(other.write(1016, {100}) == Exception::kBusy);
  CHECK(other.write(1009, {0}) == Exception::kBusy);
  CHECK(other.write(1000, {3, 1}) == Exception::kBusy);
  CHECK(other.write(1006, {1}) == Exception::kNone);  // the master's watchdog goes on
  CHECK(plc.write(1016, {100}) == Exception::kNone);
  CHECK(plc.write(1009, {0}) == Exception::kNone);
  CHECK(other.read(1207) == 0);
  CHECK(other.write(1016, {101}) == Exception::kNone);
  CHECK(plc.write(1009, {1}) == Exception::kNone);
  CHECK(other.write(1016, {102}, 29 * kSecond) == Exception::kBusy);
  CHECK(other.write(1016, {102}, 31 * kSecond) == Exception::kNone);  // its own unlock was renewed at 29 s
  plc.write(1004, {kDefaultWriteKey}, 32 * kSecond);
  CHECK(other.read(1009) == 0);  // the key alone does not make it exclusive again
  CHECK(other.write(1016, {103}, 33 * kSecond) == Exception::kNone);
}

TEST_CASE("control: the master is lost when register 1006 is not written in time, and back when it is") {
  constexpr std::int64_t kMs = 1'000'000;
  Control control;
  Client client(control);
  client.write(1004, {kDefaultWriteKey}, kSecond);
  CHECK_FALSE(control.is_master_lost(1000 * kSecond));  // off by default
  CHECK(client.write(1022, {500}, kSecond) == Exception::kNone);
  CHECK_FALSE(control.is_master_lost(2 * kSecond));  // counts from now on
  CHECK_FALSE(control.is_master_lost(2 * kSecond + 500 * kMs));
  CHECK(control.is_master_lost(2 * kSecond + 501 * kMs));
  CHECK(client.write(1006, {7}, 3 * kSecond) == Exception::kNone);
  CHECK(client.read(1006) == 7);
  CHECK_FALSE(control.is_master_lost(3 * kSecond + 500 * kMs));
  CHECK(client.write(1006, {7}, 3 * kSecond + 500 * kMs) == Exception::kNone);  // any value, also the same
  CHECK_FALSE(control.is_master_lost(4 * kSecond));
  CHECK(control.is_master_lost(4 * kSecond + 1 * kMs));
  CHECK(client.write(1022, {0}, 5 * kSecond) == Exception::kNone);
  CHECK_FALSE(control.is_master_lost(100 * kSecond));
}

TEST_CASE("network: an address contains itself, a network its addresses") {
  const auto contains = [](const char* list, std::uint32_t client) { return Network::parse(list)->contains(client); };
  CHECK(contains("192.168.0.7", 0xC0A80007));
  CHECK_FALSE(contains("192.168.0.7", 0xC0A80008));
  CHECK(contains("192.168.0.0/24", 0xC0A800FF));
  CHECK(contains("192.168.0.9/24", 0xC0A80001));
  CHECK_FALSE(contains("192.168.0.0/24", 0xC0A80100));
  CHECK(contains("0.0.0.0/0", 0x08080808));
  for (const char* wrong : {"", "1.2.3", "1.2.3.4/33", "1.2.3.4/", "1.2.3.4/-1", "plc", "1.2.3.4/24x", "::1"}) {
    CAPTURE(wrong);
    CHECK_FALSE(Network::parse(wrong));
  }
  CHECK_FALSE(Network::parse(std::string("1.2.3.4\0", 8)));
  CHECK(is_listed({}, 1));
  CHECK_FALSE(is_listed({*Network::parse("10.0.0.0/8")}, 1));
}

TEST_CASE("control: while clients write and the loop reads, every command is carried out once and no setting is torn") {
  constexpr int kCommands = 200;
  Control control;
  std::atomic<bool> done{false};
  int taken = 0;
  bool whole = true;
  std::thread loop([&] {
    for (bool last = false; !last;) {
      last = done;
      const RuntimeSettings settings = control.settings();
      whole = whole && (settings == control.factory() || settings[kContactOn] == settings[kContactOff] + 1);
      if (control.take_command()) {
        ++taken;
        control.finish(CommandResult::kDone);
      }
    }
  });
  std::thread reader([&] {
    Client client(control, 2);
    while (!done) client.read(kResultRegister);
  });
  Client client(control);
  client.write(kKeyRegister, {kDefaultWriteKey});
  for (std::uint16_t n = 1; n <= kCommands; ++n) {
    while (client.write(kFirstSettingRegister, {static_cast<std::uint16_t>(n + 1), n}) != Exception::kNone)
      std::this_thread::yield();
    while (client.write(kCommandRegister, {static_cast<std::uint16_t>(Command::kClearFault), n}) != Exception::kNone)
      std::this_thread::yield();
    while (client.read(kResultSequenceRegister) != n) std::this_thread::yield();
  }
  done = true;
  loop.join();
  reader.join();
  CHECK(taken == kCommands);
  CHECK(whole);
}

TEST_CASE("control: a block is stalled by its age, and while the camera has a fault by the time of its publication") {
  Control control;
  control.set_stale_after(300);
  RegisterImage image;
  control.note_publication(1000);
  CHECK(control.stalled_since_ns(image, 5000) == 0);  // nothing was measured yet
  image.exposure_ns = 100;
  CHECK(control.stalled_since_ns(image, 1000) == 400);
  image.words[0] = kCameraFault;
  CHECK(control.stalled_since_ns(image, 1300) == 0);
  CHECK(control.stalled_since_ns(image, 1301) == 1300);
}

TEST_CASE("control: gravity is written as one, counts as known only where it is expected, and grows old") {
  Control control;
  Client client(control);
  const std::vector<std::uint16_t> felt = {500, static_cast<std::uint16_t>(-866), 0};
  CHECK(client.write(1102, felt) == Exception::kLocked);
  client.write(1004, {kDefaultWriteKey});
  CHECK(client.write(1102, {500}) == Exception::kIllegalAddress);
  CHECK(client.write(1103, {500, 0}) == Exception::kIllegalAddress);
  CHECK(client.write(1101, {30, 0, 0, 0}) == Exception::kIllegalAddress);
  CHECK(client.write(1102, felt, kSecond) == Exception::kNone);
  CHECK(client.read(1103) == static_cast<std::uint16_t>(-866));
  CHECK_FALSE(control.felt_gravity(kSecond));  // the board file does not say that anybody writes it
  control.expect_gravity(kSecond / 2);
  REQUIRE(control.felt_gravity(kSecond + kSecond / 2));
  CHECK((*control.felt_gravity(kSecond + kSecond / 2) - Vec3f(0.5F, -0.866F, 0)).norm() < 1e-6F);
  CHECK_FALSE(control.felt_gravity(kSecond + kSecond / 2 + 1));
}
