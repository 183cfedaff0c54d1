// Requests and the exact bytes of their responses.
#include <doctest/doctest.h>
#include <sys/socket.h>

#include <string>
#include <utility>
#include <vector>

#include "tests/modbus/served.h"

using namespace finsight;
using namespace finsight::tests;

namespace {

struct Exchange {
  const char* what;
  Bytes request, reply;
};

const std::string kBasicObjects = "00 08 'Finsight' 01 04 'FS-1' 02 05 '" FINSIGHT_VERSION "'";
const std::string kOtherObjects = "04 15 'Finsight touch sensor' 05 15 'FS-1 in-finger vision'";

const std::vector<Exchange>& exchanges() {
  static const std::vector<Exchange> list = {
      {"function 3, first register", hex("0001 0000 0006 01 03 0000 0001"), hex("0001 0000 0005 01 03 02 1000")},
      {"function 4, the same block", hex("0002 0000 0006 01 04 0000 0001"), hex("0002 0000 0005 01 04 02 1000")},
      {"three registers", hex("0003 0000 0006 01 03 0005 0003"), hex("0003 0000 0009 01 03 06 1005 1006 1007")},
      {"last register", hex("0004 0000 0006 01 04 0054 0001"), hex("0004 0000 0005 01 04 02 1054")},
      {"last eight registers", hex("0005 0000 0006 01 03 0028 0008"),
       hex("0005 0000 0013 01 03 10 1028 1029 102A 102B 102C 102D 102E 102F")},
      {"transaction id is echoed", hex("FFFE 0000 0006 01 03 0014 0002"), hex("FFFE 0000 0007 01 03 04 1014 1015")},
      {"unit 0", hex("0006 0000 0006 00 03 0000 0001"), hex("0006 0000 0005 00 03 02 1000")},
      {"unit 247", hex("0007 0000 0006 F7 03 0000 0001"), hex("0007 0000 0005 F7 03 02 1000")},
      {"unit 255", hex("0008 0000 0006 FF 03 0000 0001"), hex("0008 0000 0005 FF 03 02 1000")},
      {"quantity 0", hex("0009 0000 0006 01 03 0000 0000"), hex("0009 0000 0003 01 83 03")},
      {"quantity 0 beyond the block", hex("000A 0000 0006 01 03 FFFF 0000"), hex("000A 0000 0003 01 83 03")},
      {"quantity 126", hex("000B 0000 0006 01 04 0000 007E"), hex("000B 0000 0003 01 84 03")},
      {"quantity 65535", hex("000C 0000 0006 01 03 0000 FFFF"), hex("000C 0000 0003 01 83 03")},
      {"quantity 125 over the end", hex("000D 0000 0006 01 03 0000 007D"), hex("000D 0000 0003 01 83 02")},
      {"one register over the end", hex("000E 0000 0006 01 04 0054 0002"), hex("000E 0000 0003 01 84 02")},
      {"first address beyond", hex("000F 0000 0006 01 03 0055 0001"), hex("000F 0000 0003 01 83 02")},
      {"last address of all", hex("0010 0000 0006 01 03 FFFF 0001"), hex("0010 0000 0003 01 83 02")},
      {"address 65535, 125 registers", hex("0011 0000 0006 01 03 FFFF 007D"), hex("0011 0000 0003 01 83 02")},
      {"read too short", hex("0012 0000 0005 01 03 0000 00"), hex("0012 0000 0003 01 83 03")},
      {"read too long", hex("0013 0000 0007 01 03 0000 0001 00"), hex("0013 0000 0003 01 83 03")},
      {"read without fields", hex("0014 0000 0002 01 03"), hex("0014 0000 0003 01 83 03")},
      {"read coils", hex("0015 0000 0006 01 01 0000 0001"), hex("0015 0000 0003 01 81 01")},
      {"read discrete inputs", hex("0016 0000 0006 01 02 0000 0001"), hex("0016 0000 0003 01 82 01")},
      {"write coil", hex("0017 0000 0006 01 05 0000 FF00"), hex("0017 0000 0003 01 85 01")},
      {"write a measurement", hex("0018 0000 0006 01 06 0000 0001"), hex("0018 0000 0003 01 86 02")},
      {"read exception status", hex("0019 0000 0002 01 07"), hex("0019 0000 0003 01 87 01")},
      {"diagnostics", hex("001A 0000 0006 01 08 0000 A537"), hex("001A 0000 0003 01 88 01")},
      {"write coils", hex("001B 0000 0008 01 0F 0000 0008 01 FF"), hex("001B 0000 0003 01 8F 01")},
      {"write measurements", hex("001C 0000 0009 01 10 0000 0001 02 0001"), hex("001C 0000 0003 01 90 02")},
      {"report server id", hex("001D 0000 0002 01 11"), hex("001D 0000 0003 01 91 01")},
      {"mask write", hex("001E 0000 0008 01 16 0000 0000 0000"), hex("001E 0000 0003 01 96 01")},
      {"read and write a measurement", hex("001F 0000 000D 01 17 0000 0001 0000 0001 02 0001"),
       hex("001F 0000 0003 01 97 02")},
      {"function 0", hex("0020 0000 0002 01 00"), hex("0020 0000 0003 01 80 01")},
      {"an exception as a request", hex("0021 0000 0003 01 83 02"), hex("0021 0000 0003 01 83 01")},
      {"function 255", hex("0022 0000 0002 01 FF"), hex("0022 0000 0003 01 FF 01")},
      {"longest request", hex("0023 0000 00FE 01 10") + Bytes(252, 0xFF), hex("0023 0000 0003 01 90 03")},
      {"identification, basic", hex("0024 0000 0005 01 2B 0E 01 00"),
       hex("0024 0000 001F 01 2B 0E 01 82 00 00 03 " + kBasicObjects)},
      {"identification, regular", hex("0025 0000 0005 01 2B 0E 02 00"),
       hex("0025 0000 004D 01 2B 0E 02 82 00 00 05 " + kBasicObjects + kOtherObjects)},
      {"identification, extended", hex("0026 0000 0005 01 2B 0E 03 00"),
       hex("0026 0000 004D 01 2B 0E 03 82 00 00 05 " + kBasicObjects + kOtherObjects)},
      {"identification, one object", hex("0027 0000 0005 FF 2B 0E 04 01"),
       hex("0027 0000 000E FF 2B 0E 04 82 00 00 01 01 04 'FS-1'")},
      {"identification, unknown object", hex("0028 0000 0005 01 2B 0E 04 03"), hex("0028 0000 0003 01 AB 02")},
      {"identification, unknown code", hex("0029 0000 0005 01 2B 0E 05 00"), hex("0029 0000 0003 01 AB 03")},
      {"identification too short", hex("002A 0000 0003 01 2B 0E"), hex("002A 0000 0003 01 AB 03")},
      {"settings", hex("002C 0000 0006 01 03 03F2 0003"), hex("002C 0000 0009 01 03 06 0014 000A 00C8")},
      {"last setting", hex("002D 0000 0006 01 04 03FE 0001"), hex("002D 0000 0005 01 04 02 0000")},
      {"before the commands", hex("002E 0000 0006 01 03 03E7 0002"), hex("002E 0000 0003 01 83 02")},
      {"behind the settings", hex("002F 0000 0006 01 03 0403 0002"), hex("002F 0000 0003 01 83 02")},
      {"a locked write", hex("0030 0000 0006 01 06 03F2 0032"), hex("0030 0000 0003 01 86 04")},
      {"the wrong key", hex("0031 0000 0006 01 06 03EC 0001"), hex("0031 0000 0003 01 86 03")},
      {"the key", hex("0032 0000 0006 01 06 03EC 4653"), hex("0032 0000 0006 01 06 03EC 4653")},
      {"a write", hex("0033 0000 0006 01 06 03F2 0032"), hex("0033 0000 0006 01 06 03F2 0032")},
      {"a write of two", hex("0034 0000 000B 01 10 03F2 0002 04 0014 000A"), hex("0034 0000 0006 01 10 03F2 0002")},
      {"a write without its bytes", hex("0035 0000 0009 01 10 03F2 0002 02 0014"), hex("0035 0000 0003 01 90 03")},
      {"a write of no registers", hex("0036 0000 0007 01 10 03F2 0000 00"), hex("0036 0000 0003 01 90 03")},
      {"a write of 124 registers", hex("0037 0000 00FE 01 10 03F2 007C F8") + Bytes(247, 0),
       hex("0037 0000 0003 01 90 03")},
      {"a write to a read-only register", hex("0038 0000 0006 01 06 03EA 0001"), hex("0038 0000 0003 01 86 02")},
      {"a write across a read-only register", hex("0039 0000 000D 01 10 03E8 0003 06 0000 0000 0000"),
       hex("0039 0000 0003 01 90 02")},
      {"a value out of range", hex("003A 0000 0006 01 06 03F8 2711"), hex("003A 0000 0003 01 86 03")},
      {"on not above off", hex("003B 0000 0006 01 06 03F2 000A"), hex("003B 0000 0003 01 86 03")},
      {"write and read", hex("003C 0000 000D 01 17 03F2 0001 03F2 0001 02 0032"), hex("003C 0000 0005 01 17 02 0032")},
      {"write, and read registers that do not exist", hex("003D 0000 000D 01 17 0055 0001 03F2 0001 02 0014"),
       hex("003D 0000 0003 01 97 02")},
      {"which wrote nothing", hex("003E 0000 0006 01 03 03F2 0001"), hex("003E 0000 0005 01 03 02 0032")},
      {"the former value again", hex("003F 0000 0006 01 06 03F2 0014"), hex("003F 0000 0006 01 06 03F2 0014")},
      {"a command without its number", hex("0040 0000 0006 01 06 03E8 0007"), hex("0040 0000 0003 01 86 02")},
      {"a number without its command", hex("0041 0000 0006 01 06 03E9 0007"), hex("0041 0000 0003 01 86 02")},
      {"a number without its command, function 16", hex("0042 0000 0009 01 10 03E9 0001 02 0007"),
       hex("0042 0000 0003 01 90 02")},
      {"a command with number 0", hex("0043 0000 000B 01 10 03E8 0002 04 0003 0000"), hex("0043 0000 0003 01 90 03")},
      {"last register of the history", hex("0044 0000 0006 01 03 04E1 0001"), hex("0044 0000 0005 01 03 02 0000")},
      {"behind the history", hex("0045 0000 0006 01 03 04E1 0002"), hex("0045 0000 0003 01 83 02")},
      {"a write to the history", hex("0046 0000 0006 01 06 04B0 0001"), hex("0046 0000 0003 01 86 02")},
      {"in the diagnostics: the firmware's version", hex("0047 0000 0006 01 04 0BFE 0001"),
       hex("0047 0000 0005 01 04 02 '" + std::string(FINSIGHT_VERSION).substr(0, 2) + "'")},
      {"behind the diagnostics", hex("0048 0000 0006 01 03 0C34 0002"), hex("0048 0000 0003 01 83 02")},
      {"before the diagnostics", hex("0049 0000 0006 01 03 0BB7 0001"), hex("0049 0000 0003 01 83 02")},
      {"a write to the diagnostics", hex("004A 0000 0006 01 06 0BB8 0001"), hex("004A 0000 0003 01 86 02")},
      {"another encapsulated interface", hex("002B 0000 0005 01 2B 0D 01 00"), hex("002B 0000 0003 01 AB 01")},
  };
  return list;
}

std::pair<Bytes, Bytes> all_exchanges() {
  std::pair<Bytes, Bytes> all;
  for (const Exchange& e : exchanges()) {
    all.first = all.first + e.request;
    all.second = all.second + e.reply;
  }
  return all;
}

}  // namespace

TEST_CASE("server: every request of the list gets its exact response") {
  Served served;
  Connection client(served.port());
  for (const Exchange& e : exchanges())
    CHECK_MESSAGE(client.ask(e.request, e.reply.size()) == e.reply, std::string(e.what));
}

TEST_CASE("server: requests that arrive byte by byte are answered in order") {
  Served served;
  Connection client(served.port());
  const auto [requests, replies] = all_exchanges();
  for (const std::uint8_t byte : requests) REQUIRE(client.send({byte}));
  CHECK(client.receive(replies.size()) == replies);
}

TEST_CASE(
    "server: many requests in one segment are all answered in order, even after the client has shut its side down") {
  Served served;
  Connection client(served.port());
  const auto [requests, replies] = all_exchanges();
  REQUIRE(client.send(requests + kReadOne));
  ::shutdown(client.fd(), SHUT_WR);
  CHECK(client.receive(replies.size() + kReadOneReply.size()) == replies + kReadOneReply);
  CHECK(client.is_closed_by_server());
}

TEST_CASE("server: reserved unit ids get no answer, and the connection stays open") {
  Served served;
  Connection client(served.port());
  for (int unit = 248; unit < 255; ++unit) {
    Bytes request = kReadOne;
    request[6] = static_cast<std::uint8_t>(unit);
    REQUIRE(client.send(request));
  }
  CHECK(is_answered(client));
}

TEST_CASE("server: an invalid header closes the connection, after the requests before it have been answered") {
  Served served;
  Connection bystander(served.port());
  for (const char* header : {"0001 0001 0006 01 03 0000 0001",  // protocol id
                             "0001 0100 0006 01 03 0000 0001",  //
                             "0001 0000 0000 01 03 0000 0001",  // length without unit id
                             "0001 0000 0001 01 03 0000 0001",  // length without function
                             "0001 0000 00FF 01 03 0000 0001",  // longer than any PDU
                             "0001 0000 FFFF 01 03 0000 0001",  //
                             "'GET / HTTP/1.1'", "'\r\n\r\n\r\n\r\n'"}) {
    Connection client(served.port());
    CHECK_MESSAGE(client.ask(kReadOne + hex(header), kReadOneReply.size()) == kReadOneReply, std::string(header));
    CHECK_MESSAGE(client.is_closed_by_server(), std::string(header));
    CHECK(is_answered(bystander));
  }
}
