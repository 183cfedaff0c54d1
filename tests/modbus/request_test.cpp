#include "firmware/modbus/request.h"

#include <doctest/doctest.h>

#include <array>
#include <string>
#include <vector>

#include "firmware/types.h"

using namespace finsight;

namespace {

using Bytes = std::vector<std::uint8_t>;

/// The response of a device whose register i holds 0x1000 + i; the client may write and has unlocked.
Bytes answer(const Bytes& request) {
  Control control;
  DeviceView device{{}, control, 0};
  for (std::size_t i = 0; i < device.image.words.size(); ++i)
    device.image.words[i] = static_cast<std::uint16_t>(0x1000 + i);
  for (std::size_t i = 0; i < device.image.process.size(); ++i)
    device.image.process[i] = static_cast<std::uint16_t>(0x2000 + i);
  const ClientAccess access{.may_write = true};
  control.write(kKeyRegister, std::array{kDefaultWriteKey}, access, 0);
  std::array<std::uint8_t, kMaxPdu> reply{};
  const std::size_t length = answer_request(request, device, access, reply);
  return {reply.begin(), reply.begin() + static_cast<std::ptrdiff_t>(length)};
}

Bytes read_request(int function, int address, int quantity) {
  const auto byte = [](int value) { return static_cast<std::uint8_t>(value); };
  return {byte(function), byte(address >> 8), byte(address), byte(quantity >> 8), byte(quantity)};
}

/// The identification objects in a response, in order, as "id=text".
std::vector<std::string> objects_in(const Bytes& reply) {
  std::vector<std::string> objects;
  std::size_t at = 7;
  for (int i = 0; i < reply[6]; ++i) {
    REQUIRE(at + 2 <= reply.size());
    REQUIRE(at + 2 + reply[at + 1] <= reply.size());
    objects.push_back(std::to_string(reply[at]) + "=" + std::string(&reply[at + 2], &reply[at + 2] + reply[at + 1]));
    at += 2U + reply[at + 1];
  }
  CHECK(at == reply.size());
  return objects;
}

const std::vector<std::string> kBasic = {"0=Finsight", "1=FS-1", "2=" FINSIGHT_VERSION};
const std::vector<std::string> kAll = {"0=Finsight", "1=FS-1", "2=" FINSIGHT_VERSION, "4=Finsight touch sensor",
                                       "5=FS-1 in-finger vision"};

}  // namespace

TEST_CASE("request: a read succeeds exactly when the Modbus specification allows it") {
  int wrong = 0;
  for (const int function : {3, 4}) {
    for (int address = 0; address < 65536;
         address += address < 60 || address > 65500 || (address > 995 && address < 1140) ||
                            (address > 1190 && address < 1255) || (address > 1990 && address < 2080) ||
                            (address > 2990 && address < 3130)
                        ? 1
                        : 97) {
      for (const int quantity : {0, 1, 2, 40, 84, 85, 86, 124, 125, 126, 127, 255, 256, 32768, 65535}) {
        const auto is_in = [&](int first, int count) {
          return address >= first && address + quantity <= first + count;
        };
        const bool in_control =
            is_in(kControlAddress, kControlRegisters) || is_in(kProcessAddress, kProcessBlockRegisters) ||
            is_in(kHistoryAddress, kHistoryRegisters) || is_in(kGatheredAddress, kGatheredRegisters) ||
            is_in(kDiagnosticsAddress, kDiagnosticsRegisters);
        Bytes expected;
        if (quantity == 0 || quantity > 125) {
          expected = {static_cast<std::uint8_t>(function + 128), 3};
        } else if (address + quantity > kMeasurementRegisters && !in_control) {
          expected = {static_cast<std::uint8_t>(function + 128), 2};
        }
        const Bytes reply = answer(read_request(function, address, quantity));
        const std::size_t length = 2 + 2 * static_cast<std::size_t>(quantity);
        const bool is_read = reply.size() == length && reply[0] == function && reply[1] == length - 2;
        if (expected.empty() ? !is_read : reply != expected) ++wrong;
      }
    }
  }
  CHECK(wrong == 0);
}

TEST_CASE("request: settings and values of the process helpers are read together") {
  const Bytes reply = answer(read_request(3, kProcessAddress, kProcessBlockRegisters));
  REQUIRE(reply.size() == 2 + 2 * kProcessBlockRegisters);
  const auto word = [&](int address) {
    const std::size_t at = 2 + 2 * static_cast<std::size_t>(address - kProcessAddress);
    return reply[at] << 8 | reply[at + 1];
  };
  CHECK(word(1101) == setting_row(kGripChange).factory);
  CHECK(word(1102) == 0);
  CHECK(word(kProcessValueAddress) == 0x2000);
  CHECK(word(1134) == 0x2018);
}

TEST_CASE("request: every other function code gets exception 1, whatever follows it") {
  for (int function = 0; function < 256; ++function) {
    if (function == 3 || function == 4 || function == 6 || function == 16 || function == 23 || function == 43) continue;
    for (const std::size_t length : {1U, 5U, 253U}) {
      Bytes request(length, 0xA5);
      request[0] = static_cast<std::uint8_t>(function);
      CHECK(answer(request) == Bytes{static_cast<std::uint8_t>(function | 0x80), 1});
    }
  }
}

TEST_CASE("request: a read of the wrong length gets exception 3") {
  for (std::size_t length = 1; length <= kMaxPdu; ++length) {
    Bytes request = read_request(3, 0, 1);
    request.resize(length);
    CHECK(answer(request) == (length == 5 ? Bytes{3, 2, 0x10, 0x00} : Bytes{0x83, 3}));
  }
}

TEST_CASE("request: identification lists the objects of its category from the requested one on") {
  CHECK(objects_in(answer({43, 14, 1, 0})) == kBasic);
  CHECK(objects_in(answer({43, 14, 2, 0})) == kAll);
  CHECK(objects_in(answer({43, 14, 3, 0})) == kAll);  // extended: there are no more
  CHECK(objects_in(answer({43, 14, 1, 1})) == std::vector<std::string>{kBasic[1], kBasic[2]});
  CHECK(objects_in(answer({43, 14, 2, 4})) == std::vector<std::string>{kAll[3], kAll[4]});
  CHECK(objects_in(answer({43, 14, 1, 4})) == kBasic);  // not a basic object: from the beginning
  CHECK(objects_in(answer({43, 14, 2, 3})) == kAll);    // unknown: from the beginning
  CHECK(objects_in(answer({43, 14, 2, 255})) == kAll);
}

TEST_CASE("request: identification returns single objects, and exception 2 for unknown ones") {
  for (int id = 0; id < 256; ++id) {
    const Bytes reply = answer({43, 14, 4, static_cast<std::uint8_t>(id)});
    const std::string start = std::to_string(id) + "=";
    std::vector<std::string> expected;
    for (const std::string& object : kAll) {
      if (object.starts_with(start)) expected.push_back(object);
    }
    if (expected.empty()) {
      CHECK(reply == Bytes{0xAB, 2});
    } else {
      CHECK(Bytes(reply.begin(), reply.begin() + 7) == Bytes{43, 14, 4, 0x82, 0, 0, 1});
      CHECK(objects_in(reply) == expected);
    }
  }
}

TEST_CASE("request: a malformed identification request gets the exception for what is wrong with it") {
  CHECK(answer({43}) == Bytes{0xAB, 1});
  CHECK(answer({43, 13, 1, 0}) == Bytes{0xAB, 1});
  CHECK(answer({43, 14}) == Bytes{0xAB, 3});
  CHECK(answer({43, 14, 1}) == Bytes{0xAB, 3});
  CHECK(answer({43, 14, 1, 0, 0}) == Bytes{0xAB, 3});
  for (int code = 0; code < 256; ++code) {
    if (code >= 1 && code <= 4) continue;
    CHECK(answer({43, 14, static_cast<std::uint8_t>(code), 0}) == Bytes{0xAB, 3});
  }
}

TEST_CASE("request: a million random requests each get a complete response of their function or an exception") {
  std::uint64_t state = 1;
  const auto random = [&state] {  // splitmix64
    std::uint64_t z = state += 0x9E3779B97F4A7C15U;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9U;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBU;
    return z ^ (z >> 31);
  };
  constexpr std::array<std::uint8_t, 8> kKnown = {3, 4, 6, 16, 23, 43, 6, 16};
  std::array<std::uint8_t, kMaxPdu> request, reply;
  Control control;
  const DeviceView device{{}, control, 0};
  const ClientAccess access{.may_write = true};
  int odd = 0, reads = 0, writes = 0, identifications = 0;
  for (int i = 0; i < 1'000'000; ++i) {
    control.write(kKeyRegister, std::array{kDefaultWriteKey}, access, 0);
    const std::uint64_t bits = random();
    // Half of them are almost valid, so that they pass the first checks and reach those behind.
    const bool tame = bits & 1;
    std::size_t length = 1 + (bits >> 8) % (tame ? 6 : kMaxPdu);
    for (std::size_t b = 0; b < length; ++b) request[b] = random() & (tame ? 0x0F : 0xFF);
    if (tame) request[0] = kKnown[bits >> 1 & 7];
    if (tame && bits & 16) {  // commands and settings
      request[1] = 0x03;
      request[2] = static_cast<std::uint8_t>(0xE8 + (bits >> 32) % 23);
    }
    if (tame && request[0] == 16 && length == 6) {
      request[3] = 0;
      request[4] &= 3;
      request[5] = static_cast<std::uint8_t>(2 * request[4]);
      length += request[5];
      for (std::size_t b = 6; b < length; ++b) request[b] = random() & 0x0F;
    }
    const std::size_t answered = answer_request({request.data(), length}, device, access, reply);
    if (const auto command = control.take_command()) control.finish(CommandResult::kDone);
    const bool is_read = reply[0] == request[0] && (reply[0] == 3 || reply[0] == 4) && answered == 2U + reply[1];
    const bool is_write = reply[0] == request[0] && (reply[0] == 6 || reply[0] == 16) && answered == 5;
    const bool is_both = reply[0] == 23 && request[0] == 23 && answered == 2U + reply[1];
    const bool is_identity = answered > 7 && request[0] == 43 && reply[0] == 43;
    const bool is_exception = answered == 2 && reply[0] == (request[0] | 0x80) && reply[1] >= 1 && reply[1] <= 4;
    odd += !is_read && !is_write && !is_both && !is_identity && !is_exception;
    reads += is_read;
    writes += is_write;
    identifications += is_identity;
  }
  CHECK(odd == 0);
  CHECK(reads > 100);
  CHECK(writes > 100);
  CHECK(identifications > 20);
}

TEST_CASE("request: a new word order holds at once for the whole block, also while no new one comes") {
  Control control;
  const ClientAccess access{.may_write = true};
  control.write(kKeyRegister, std::array{kDefaultWriteKey}, access, 0);
  DeviceView device{empty_block(), control, 0};
  device.image.words[32] = 1;  // a frame counter of 65538
  device.image.words[33] = 2;
  const auto words = [&](const std::string& request_before) {
    std::array<std::uint8_t, kMaxPdu> reply{};
    const Bytes request =
        request_before.empty() ? read_request(3, 0, 48) : Bytes(request_before.begin(), request_before.end());
    answer_request(request, device, access, reply);
    std::vector<int> read;
    for (std::size_t at = 2; at < 98; at += 2) read.push_back(reply[at] << 8 | reply[at + 1]);
    return read;
  };
  // Function 23: the write comes before the read in the same request.
  const std::string sets_cdab("\x17\0\0\0\x30\x03\xFB\0\x01\x02\0\x01", 12);
  for (const bool is_stalled : {false, true}) {
    CAPTURE(is_stalled);
    if (is_stalled) mark_stalled(device.image, control.settings_copy());
    REQUIRE(control.write(1019, std::array<std::uint16_t, 1>{0}, access, 0) == Exception::kNone);
    CHECK(words("")[46] == 0x1234);
    CHECK(words("")[33] == 2);
    CHECK(words("")[20] == 0x7FC0);
    for (const std::string& request : {sets_cdab, std::string()}) {
      const std::vector<int> read = words(request);
      CHECK(read[46] == 0x5678);
      CHECK(read[47] == 0x1234);
      CHECK(read[33] == 1);
      CHECK(read[20] == 0);
      CHECK(read[21] == 0x7FC0);
    }
  }
}
