#include <doctest/doctest.h>

#include <array>
#include <atomic>
#include <string>
#include <thread>

#include "firmware/modbus/server.h"
#include "tests/modbus/served.h"

using namespace finsight;
using namespace finsight::tests;

TEST_CASE("server: units 1 and 2 are two fingers, every unit has the block of both, and unit 3 is no finger") {
  Control first, second;
  ModbusSettings settings;
  settings.port = 0;
  ModbusServer server(settings, std::array{&first, &second});
  const auto publish = [&](std::size_t finger, std::uint16_t force) {
    RegisterImage image = empty_block();
    image.words[static_cast<std::size_t>(address_of("heartbeat"))] = force;
    image.words[static_cast<std::size_t>(address_of("force"))] = force;
    server.publish(image, finger);
  };
  publish(0, 0x0111);
  publish(1, 0x0222);
  Connection client(server.port());
  const auto force_of = [](const std::string& unit) { return hex("0001 0000 0006 " + unit + " 03 0009 0001"); };
  CHECK(client.ask(force_of("01"), 11) == hex("0001 0000 0005 01 03 02 0111"));
  CHECK(client.ask(force_of("02"), 11) == hex("0001 0000 0005 02 03 02 0222"));
  CHECK(client.ask(force_of("FF"), 11) == hex("0001 0000 0005 FF 03 02 0111"));
  CHECK(client.ask(force_of("03"), 9) == hex("0001 0000 0003 03 83 0B"));  // gateway target failed to respond
  for (const std::string unit : {"01", "02", "FF"}) {
    CAPTURE(unit);
    const Bytes reply = client.ask(hex("0001 0000 0006 " + unit + " 03 07D0 004A"), 9 + 2 * kGatheredRegisters);
    REQUIRE(reply.size() == 9 + 2 * kGatheredRegisters);
    CHECK(word_at(reply, 0) == 2);
    CHECK(word_at(reply, address_of("finger_1_force") - kGatheredAddress) == 0x0111);
    CHECK(word_at(reply, address_of("finger_2_force") - kGatheredAddress) == 0x0222);
    CHECK(word_at(reply, address_of("finger_3_force") - kGatheredAddress) == 0xFFFF);
  }
  // What is written to one finger changes nothing of the other's.
  CHECK(client.ask(hex("0001 0000 0006 02 06 03EC 4653"), 12) == hex("0001 0000 0006 02 06 03EC 4653"));
  CHECK(client.ask(hex("0001 0000 0006 02 06 03F8 004D"), 12) == hex("0001 0000 0006 02 06 03F8 004D"));
  CHECK(second.settings()[kHoldTime] == 77);
  CHECK(first.settings()[kHoldTime] == 200);
  CHECK(client.ask(hex("0001 0000 0006 01 06 03F8 004D"), 9) == hex("0001 0000 0003 01 86 04"));  // locked
}

TEST_CASE("server: a block that gathers the fingers is of one moment, while each finger publishes its own") {
  Control first, second;
  ModbusSettings settings;
  settings.port = 0;
  ModbusServer server(settings, std::array{&first, &second});
  std::atomic<bool> stop{false};
  // Every word of a block that its finger's part repeats has the same number.
  const auto write = [&](std::size_t finger) {
    RegisterImage image;
    for (std::uint16_t n = 0; !stop; ++n) {
      image.words.fill(n);
      server.publish(image, finger);
    }
  };
  for (const std::size_t finger : {0U, 1U}) server.publish(RegisterImage{}, finger);
  std::thread left([&] { write(0); }), right([&] { write(1); });
  Connection client(server.port());
  int torn = 0;
  for (int i = 0; i < 300; ++i) {
    const Bytes reply = client.ask(hex("0001 0000 0006 01 03 07D0 004A"), 9 + 2 * kGatheredRegisters);
    if (reply.size() != 9 + 2 * kGatheredRegisters) ++torn;
    for (std::size_t finger = 0; finger < 2 && torn == 0; ++finger) {
      const std::size_t begin =
          static_cast<std::size_t>(address_of("finger_1_status") - kGatheredAddress) + finger * kFingerStride;
      for (std::size_t word = 1; word < kFingerStride; ++word) {
        if (word != 3 && word_at(reply, begin + word) != word_at(reply, begin)) ++torn;  // but the age
      }
    }
  }
  stop = true;
  left.join();
  right.join();
  CHECK(torn == 0);
}
