#include "firmware/device/safe_mode.h"

#include <doctest/doctest.h>

#include <chrono>
#include <cmath>
#include <future>
#include <string>

#include "firmware/device/saved_state.h"
#include "tests/modbus/served.h"
#include "tests/model/scratch_folder.h"
#include "tests/model/tiny_model.h"

using namespace finsight;

namespace {

const std::string kBoard = "pack = \"p\"\n[source]\nkind = \"session\"\npath = \"s\"\n[modbus]\nport = 0\n";
const std::string kNonsense = "[nonsense]\n";  // makes the strict reader refuse the file

/// The measurement block; empty without an answer.
std::vector<std::uint16_t> block_of(tests::Connection& client) {
  const auto reply = client.ask(tests::hex("0001 0000 0006 01 03 0000 0030"), 9 + 2 * 48);
  if (reply.size() != 9 + 2 * 48) return {};
  std::vector<std::uint16_t> words;
  for (std::size_t word = 0; word < 48; ++word) words.push_back(tests::word_at(reply, word));
  return words;
}

/// Safe mode at work, and a client of it.
class Serving {
 public:
  Serving(const test::ScratchFolder& folder, const std::string& board, FaultCode fault = FaultCode::kSettingsRefused)
      : mode_(folder.write("board.toml", board), fault),
        ended_(std::async(std::launch::async, [this] { return mode_.run(stop_); })),
        client_(mode_.port()) {}
  ~Serving() { end(); }
  std::vector<std::uint16_t> block() { return block_of(client_); }
  void send(const std::string& request) { client_.send(tests::hex(request)); }
  tests::Bytes ask(const std::string& request, std::size_t bytes) { return client_.ask(tests::hex(request), bytes); }
  bool is_answered(const std::string& request, std::size_t bytes) { return ask(request, bytes).size() == bytes; }
  /// Whether safe mode ended because it was told to, not by a reset.
  bool end() {
    stop_ = true;
    return ended_.valid() ? ended_.get() : result_;
  }
  bool ends_by_itself() {
    if (ended_.wait_for(std::chrono::seconds(10)) != std::future_status::ready) return false;
    result_ = ended_.get();
    return !result_;
  }

 private:
  SafeMode mode_;
  std::atomic<bool> stop_{false};
  bool result_ = true;
  std::future<bool> ended_;
  tests::Connection client_;
};

float abcd(std::uint16_t high, std::uint16_t low) {
  return std::bit_cast<float>(static_cast<std::uint32_t>(high) << 16 | low);
}

}  // namespace

TEST_CASE("safe mode: serves the fault, and no value as measured") {
  const test::ScratchFolder folder;
  for (const FaultCode fault : {FaultCode::kSettingsRefused, FaultCode::kFailedRepeatedly}) {
    Serving safe(folder, kBoard, fault);
    const auto words = safe.block();
    REQUIRE(words.size() == 48);
    CHECK(words[0] == kAnyFault);
    CHECK(words[1] == static_cast<std::uint16_t>(fault));
    CHECK(words[5] == 0x8000);
    CHECK(words[9] == 0xFFFF);
    CHECK(std::isnan(abcd(words[20], words[21])));
    CHECK(safe.end());
  }
}

TEST_CASE("safe mode: its very first answer has the fault") {
  const test::ScratchFolder folder;
  SafeMode not_running(folder.write("board.toml", kBoard), FaultCode::kSettingsRefused);
  tests::Connection client(not_running.port());
  const auto words = block_of(client);
  REQUIRE(words.size() == 48);
  CHECK(words[0] == kAnyFault);
  CHECK(words[1] == 5);
  CHECK(words[2] == 1);  // the heartbeat
}

TEST_CASE("safe mode: tells in the diagnostics who the device is, and the fault since when") {
  const test::ScratchFolder folder;
  for (const std::string& more : {std::string(), kNonsense}) {
    Serving safe(folder, kBoard + "[device]\nserial_number = \"FS-0042\"\ncalibration_date = \"2026-11-22\"\n" + more);
    REQUIRE(safe.block().size() == 48);
    std::this_thread::sleep_for(std::chrono::milliseconds(50));  // the fault is noted just after it is published
    const auto reply = safe.ask("0002 0000 0006 01 03 0BB8 0077", 9 + 2 * 119);
    REQUIRE(reply.size() == 9 + 2 * 119);
    const auto at = [&](int address) { return tests::word_at(reply, static_cast<std::size_t>(address - 3000)); };
    CHECK(at(address_of("serial_number")) == ('F' << 8 | 'S'));
    CHECK(at(address_of("firmware_version")) != 0);
    CHECK(at(address_of("calibration_date")) == 20261122 >> 16);
    CHECK(at(address_of("faults_counted")) == 1);
    CHECK(at(address_of("fault_1_code")) == 5);
    CHECK(at(address_of("fault_1_lasted")) == 65535);  // it stands
  }
}

TEST_CASE("safe mode: names the model, if that is not what ends the firmware") {
  const test::ScratchFolder folder;
  test::TinyModel().write(folder / "p");
  for (const FaultCode fault : {FaultCode::kSelfTest, FaultCode::kFailedRepeatedly}) {
    Serving safe(folder, kBoard, fault);
    const auto reply = safe.ask("0001 0000 0006 01 03 0BDE 0010", 9 + 2 * 16);
    REQUIRE(reply.size() == 9 + 2 * 16);
    CHECK((tests::word_at(reply, 0) != 0) == (fault == FaultCode::kSelfTest));
  }
}

TEST_CASE("safe mode: with the saved word order CDAB invalid floats are NaN") {
  const test::ScratchFolder folder;
  SavedState saved;
  saved.settings[kWordOrder] = 1;
  save_state(folder / "state.toml", saved, {});
  for (const std::string& more : {std::string(), kNonsense}) {
    Serving safe(folder, kBoard + "[storage]\nsettings = \"state.toml\"\n" + more);
    const auto words = safe.block();
    REQUIRE(words.size() == 48);
    CHECK(words[46] == 0x5678);  // the test constant, low word first
    CHECK(std::isnan(abcd(words[21], words[20])));
  }
}

TEST_CASE("safe mode: a saved file that is not valid does not stop it") {
  const test::ScratchFolder folder;
  folder.write("state.toml", "version = 9\n");
  Serving safe(folder, kBoard + "[storage]\nsettings = \"state.toml\"\n");
  CHECK(safe.block().size() == 48);
}

TEST_CASE("safe mode: the list of allowed clients and the unit id still apply") {
  const test::ScratchFolder folder;
  {
    Serving safe(folder, kBoard + "allow = [\"10.0.0.0/8\"]\n" + kNonsense);
    CHECK(safe.block().empty());
  }
  Serving safe(folder, kBoard + "unit = 9\n" + kNonsense);
  safe.send("0001 0000 0006 01 03 0000 0001");
  const auto reply = safe.ask("0002 0000 0006 09 03 0000 0001", 11);  // the first and only answer
  REQUIRE(reply.size() == 11);
  CHECK(reply[1] == 2);
}

TEST_CASE("safe mode: the fallback port keeps every restriction") {
  ModbusSettings settings{.address = "192.0.2.1", .port = 1502, .max_clients = 3, .unit = 9};
  settings.allow = {*Network::parse("10.0.0.0/8")};
  settings.allow_writes = {*Network::parse("10.0.0.7")};
  const ModbusSettings fallback = fallback_settings(settings);
  CHECK(fallback.address == "0.0.0.0");
  CHECK(fallback.port == 502);
  CHECK(fallback.unit == 9);
  CHECK(fallback.max_clients == 3);
  REQUIRE(fallback.allow.size() == 1);
  CHECK_FALSE(fallback.allow[0].contains(0x7F000001));
  REQUIRE(fallback.allow_writes.size() == 1);
  CHECK(fallback.allow_writes[0].address == 0x0A000007);
}

TEST_CASE("safe mode: ends after its time, so that the sensor is tried again") {
  const test::ScratchFolder folder;
  folder.write("board.toml", kBoard);
  SafeMode safe(SettingsFiles(folder / "board.toml"), FaultCode::kFailedRepeatedly);
  const std::atomic<bool> stop{false};
  const std::int64_t began_ns = steady_now_ns();
  CHECK_FALSE(safe.run(stop, std::chrono::milliseconds(300)));
  CHECK(steady_now_ns() - began_ns > 300 * kNsPerMs);
}

TEST_CASE("safe mode: a reset is carried out, any other command is not possible") {
  const test::ScratchFolder folder;
  Serving safe(folder, kBoard);
  REQUIRE(safe.block().size() == 48);
  CHECK(safe.is_answered("0001 0000 0006 01 06 03EC 4653", 12));               // the write key
  CHECK(safe.is_answered("0002 0000 000B 01 10 03E8 0002 04 0001 0001", 12));  // zero, number 1
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  CHECK(safe.is_answered("0003 0000 000B 01 10 03E8 0002 04 0006 0002", 12));  // reset, number 2
  CHECK(safe.ends_by_itself());
}
