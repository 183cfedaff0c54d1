// Every command that clients have given: what makes a number new, repeated or used, and what the history's registers
// show.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/modbus/register_table.h"

namespace finsight {

/// The addresses of clients that have none.
inline constexpr std::uint32_t kNobody = 0, kSerialLineClient = 1;

/// The client that a request comes from.
struct ClientAccess {
  bool may_write = false;        ///< its address is on the list of those that may
  std::uint32_t address = 0;     ///< IPv4, host byte order, or kSerialLineClient. The key unlocks writes for it.
  std::uint64_t connection = 0;  ///< rises with every connection; 0: a line that is always open
};

/// Registers 1202 and 1203 and their like.
struct GivenCommand {
  std::uint16_t sequence = 0, command = 0;
  std::uint16_t result = 0;  ///< kRunning until it has ended
  std::uint32_t client = kNobody;
  std::uint64_t connection = 0;
  std::int64_t given_ns = 0;
};

/// Not thread-safe: under Control's mutex.
class CommandHistory {
 public:
  static constexpr std::uint16_t kRunning = value_named("history_1_result", "running");
  static constexpr std::size_t kRemembered = 1024;  ///< a number older than that is new again
  /// How long a client may repeat a command that was not answered.
  static constexpr std::int64_t kRepeat_ns = 10'000'000'000;

  enum class Number { kNew, kRepeated, kUsed };
  /// A number is repeated if it is that of the client's newest command, the command is the same, no older than
  /// kRepeat_ns, and was given over the same connection. In any other case a number that was given is used: whoever is
  /// answered must know that the command ran for them, and programs of one address look alike over new connections.
  Number judge(std::uint16_t sequence, std::uint16_t command, const ClientAccess& access, std::int64_t now_ns) const;

  /// The newest command must have ended.
  void begin(std::uint16_t sequence, std::uint16_t command, const ClientAccess& access, std::int64_t now_ns);
  void finish(std::uint16_t result);
  bool is_running() const { return given_ > 0 && newest(0).result == kRunning; }
  /// Of a device that starts again because of it: a command that was carried out before.
  void remember(const GivenCommand& given) { commands_[given_++ % kRemembered] = given; }

  const GivenCommand& last_given() const { return given_ > 0 ? newest(0) : kNone; }
  const GivenCommand& last_finished() const;
  /// All registers from 1200 on.
  void write_registers(std::span<std::uint16_t, kHistoryRegisters> words, const ClientAccess& reader,
                       std::uint32_t exclusive_client, bool low_word_first) const;

 private:
  static constexpr GivenCommand kNone{};
  const GivenCommand& newest(std::size_t before) const { return commands_[(given_ - 1 - before) % kRemembered]; }
  std::size_t remembered() const { return given_ < kRemembered ? given_ : kRemembered; }
  const GivenCommand& own(const ClientAccess& reader) const;

  std::array<GivenCommand, kRemembered> commands_{};
  std::size_t given_ = 0;
};

}  // namespace finsight
