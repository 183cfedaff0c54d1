#include "firmware/modbus/command_history.h"

#include <algorithm>
#include <cassert>

#include "firmware/modbus/block_writer.h"

namespace finsight {

namespace {

constexpr int kEntry = address_of("history_2_sequence") - address_of("history_1_sequence");
static_assert(address_of("history_8_client") == address_of("history_1_client") + 7 * kEntry);

}  // namespace

CommandHistory::Number CommandHistory::judge(std::uint16_t sequence, std::uint16_t command, const ClientAccess& access,
                                             std::int64_t now_ns) const {
  bool has_given_another = false;  // since then
  for (std::size_t i = 0; i < remembered(); ++i) {
    const GivenCommand& given = newest(i);
    if (given.sequence != sequence) {
      has_given_another = has_given_another || given.client == access.address;
      continue;
    }
    const bool is_same = given.command == command && given.client == access.address && !has_given_another;
    const bool may_repeat = given.connection == access.connection && now_ns - given.given_ns < kRepeat_ns;
    return is_same && may_repeat ? Number::kRepeated : Number::kUsed;
  }
  return Number::kNew;
}

void CommandHistory::begin(std::uint16_t sequence, std::uint16_t command, const ClientAccess& access,
                           std::int64_t now_ns) {
  assert(!is_running());
  commands_[given_++ % kRemembered] = {
      sequence, command, kRunning, access.address, access.connection, now_ns,
  };
}

void CommandHistory::finish(std::uint16_t result) {
  assert(is_running());
  commands_[(given_ - 1) % kRemembered].result = result;
}

const GivenCommand& CommandHistory::last_finished() const {
  const std::size_t first = is_running() ? 1 : 0;
  return first < remembered() ? newest(first) : kNone;
}

const GivenCommand& CommandHistory::own(const ClientAccess& reader) const {
  const GivenCommand* of_address = &kNone;
  for (std::size_t i = 0; i < remembered(); ++i) {
    const GivenCommand& given = newest(i);
    if (given.client != reader.address) continue;
    if (given.connection == reader.connection) return given;
    if (of_address == &kNone) of_address = &given;
  }
  return *of_address;
}

void CommandHistory::write_registers(std::span<std::uint16_t, kHistoryRegisters> words, const ClientAccess& reader,
                                     std::uint32_t exclusive_client, bool low_word_first) const {
  std::ranges::fill(words, std::uint16_t{0});
  BlockWriter block(words, kHistoryAddress, low_word_first);
  block.count(row_named("commands_given"), given_ & 0xFFFF);
  const GivenCommand& mine = own(reader);
  block.count(row_named("own_sequence"), mine.sequence);
  block.count(row_named("own_command"), mine.command);
  block.count(row_named("own_result"), mine.result);
  block.count(row_named("result_client"), last_finished().client);
  block.count(row_named("exclusive_client"), exclusive_client);
  for (int i = 0; i < kHistoryEntries && static_cast<std::size_t>(i) < remembered(); ++i) {
    // All eight look alike; a row of the first is moved to the others' addresses.
    const auto moved = [&](RegisterRow row) {
      row.address += i * kEntry;
      return row;
    };
    const GivenCommand& given = newest(static_cast<std::size_t>(i));
    block.count(moved(row_named("history_1_sequence")), given.sequence);
    block.count(moved(row_named("history_1_command")), given.command);
    block.count(moved(row_named("history_1_result")), given.result);
    block.count(moved(row_named("history_1_client")), given.client);
  }
}

}  // namespace finsight
