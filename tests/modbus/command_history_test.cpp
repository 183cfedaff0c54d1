#include "firmware/modbus/command_history.h"

#include <doctest/doctest.h>

#include <array>
#include <vector>

using namespace finsight;
using Number = CommandHistory::Number;

namespace {

constexpr std::int64_t kSecond = 1'000'000'000;
constexpr std::uint16_t kZero = 1, kClear = 3;

ClientAccess client(std::uint32_t address, std::uint64_t connection) { return {true, address, connection}; }

void give(CommandHistory& history, std::uint16_t sequence, std::uint16_t command, const ClientAccess& access,
          std::uint16_t result = 0) {
  REQUIRE(history.judge(sequence, command, access, 0) == Number::kNew);
  history.begin(sequence, command, access, 0);
  history.finish(result);
}

}  // namespace

TEST_CASE(
    "history: a number is repeated with the same command over the same connection soon after, and otherwise used") {
  CommandHistory history;
  const ClientAccess plc = client(7, 1);
  history.begin(5, kZero, plc, 0);
  CHECK(history.judge(5, kZero, plc, 9 * kSecond) == Number::kRepeated);  // while it runs
  history.finish(0);
  CHECK(history.judge(5, kZero, plc, 9 * kSecond) == Number::kRepeated);
  CHECK(history.judge(5, kZero, plc, 10 * kSecond) == Number::kUsed);  // a PLC that has started again
  CHECK(history.judge(5, kClear, plc, 0) == Number::kUsed);
  CHECK(history.judge(5, kZero, client(8, 2), 0) == Number::kUsed);  // another client
  CHECK(history.judge(5, kZero, client(7, 2), 0) == Number::kUsed);  // another connection of an open one's address
  CHECK(history.judge(6, kZero, plc, 0) == Number::kNew);
}

TEST_CASE("history: only the newest command of a client is repeated; what came in between makes its number used") {
  CommandHistory history;
  const ClientAccess plc = client(7, 1), panel = client(8, 2);
  give(history, 5, kZero, plc);
  give(history, 6, kClear, panel);
  CHECK(history.judge(5, kZero, plc, kSecond) == Number::kRepeated);
  give(history, 7, kClear, plc);
  CHECK(history.judge(5, kZero, plc, kSecond) == Number::kUsed);
  CHECK(history.judge(7, kClear, plc, kSecond) == Number::kRepeated);
}

TEST_CASE("history: over another connection of its address no number is repeated, and what became of it can be read") {
  CommandHistory history;
  give(history, 5, kZero, client(7, 3));
  CHECK(history.judge(5, kZero, client(7, 4), kSecond) == Number::kUsed);  // perhaps another program of that computer
  std::array<std::uint16_t, kHistoryRegisters> words;
  history.write_registers(words, client(7, 4), 0, false);
  CHECK(std::vector<int>(words.begin(), words.begin() + 4) == std::vector<int>{1, 5, kZero, 0});
}

TEST_CASE("history: a reset that was ordered before the start is shown as done, and its number is used") {
  CommandHistory history;
  history.remember({.sequence = 5, .command = kZero, .result = 0, .client = 7, .connection = 99});
  CHECK(history.judge(5, kZero, client(7, 1), kSecond) == Number::kUsed);
  std::array<std::uint16_t, kHistoryRegisters> words;
  history.write_registers(words, client(7, 1), 0, false);
  CHECK(std::vector<int>(words.begin(), words.begin() + 4) == std::vector<int>{1, 5, kZero, 0});
}

TEST_CASE("history: a thousand numbers are remembered") {
  CommandHistory history;
  const ClientAccess plc = client(7, 1);
  for (std::uint16_t n = 1; n <= 1025; ++n) give(history, n, kClear, plc);
  CHECK(history.judge(1, kZero, plc, 0) == Number::kNew);
  CHECK(history.judge(2, kZero, plc, 0) == Number::kUsed);
}

TEST_CASE("history: the registers list the last eight commands, the newest first, also while it runs") {
  CommandHistory history;
  for (std::uint16_t n = 1; n <= 9; ++n) give(history, n, kClear, client(0xC0A80000U + n, n), n % 4);
  history.begin(10, kZero, client(kSerialLineClient, 0), 0);
  std::array<std::uint16_t, kHistoryRegisters> words;
  history.write_registers(words, client(0xC0A80003U, 3), 0xC0A80009U, false);
  CHECK(std::vector<int>(words.begin(), words.begin() + 10) ==
        std::vector<int>{10, 3, kClear, 3, 0xC0A8, 9, 0xC0A8, 9, 0, 0});
  CHECK(std::vector<int>(words.begin() + 10, words.begin() + 15) ==
        std::vector<int>{10, kZero, CommandHistory::kRunning, 0, kSerialLineClient});
  for (int i = 1; i < kHistoryEntries; ++i) {
    const auto at = static_cast<std::size_t>(10 + 5 * i);
    CHECK(words[at] == 10 - i);
    CHECK(words[at + 2] == (10 - i) % 4);
    CHECK(words[at + 4] == 10 - i);
  }
  history.write_registers(words, client(0xC0A80009U, 9), 0, true);
  CHECK(words[4] == 9);  // the low word first
  CHECK(words[5] == 0xC0A8);
}

TEST_CASE("history: a client reads its own last command however many others came after it") {
  CommandHistory history;
  const auto own = [&](const ClientAccess& reader) {
    std::array<std::uint16_t, kHistoryRegisters> words;
    history.write_registers(words, reader, 0, false);
    return words[1];
  };
  CHECK(own(client(7, 1)) == 0);
  give(history, 100, kZero, client(7, 1));
  give(history, 200, kZero, client(7, 2));
  for (std::uint16_t n = 1; n <= 50; ++n) give(history, n, kClear, client(8, 3));
  CHECK(own(client(7, 1)) == 100);
  CHECK(own(client(7, 2)) == 200);
  CHECK(own(client(7, 9)) == 200);  // a new connection: that of its address
  CHECK(own(client(9, 10)) == 0);
}
