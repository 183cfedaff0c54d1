// Commands and settings from clients to the frame loop, and results back.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <limits>
#include <mutex>
#include <optional>
#include <span>

#include "firmware/modbus/registers.h"
#include "firmware/modbus/triple_buffer.h"

namespace finsight {

/// Register 1000.
enum class Command : std::uint16_t {
  kNone = value_named("command", "none"),
  kZero = value_named("command", "zero"),
  kSave = value_named("command", "save"),
  kClearFault = value_named("command", "clear"),
  kRecord = value_named("command", "record"),
  kStopRecording = value_named("command", "stop"),
  kReset = value_named("command", "reset"),
  kFactory = value_named("command", "factory"),
  kTareForce = value_named("command", "tare_force"),
  kTareDeformation = value_named("command", "tare_deformation"),
  kTareTouch = value_named("command", "tare_touch"),
  kClearTare = value_named("command", "clear_tare"),
  kResetPeaks = value_named("command", "reset_peaks"),
  kResetEvents = value_named("command", "reset_events"),
};

/// Register 1003.
enum class CommandResult : std::uint16_t {
  kDone = value_named("result", "done"),
  kNotPossible = value_named("result", "not_possible"),
  kNotConfigured = value_named("result", "not_configured"),
  kFailed = value_named("result", "failed"),
};

/// Exception codes of the Modbus Application Protocol V1.1b3, section 7.
enum class Exception : std::uint8_t {
  kNone = 0,
  kIllegalFunction = 1,  ///< also for a locked write: "the server is in the wrong state to process a request"
  kIllegalAddress = 2,
  kIllegalValue = 3,
  kBusy = 6
};

/// The client that a request comes from.
struct ClientAccess {
  bool may_write = false;     ///< its address is on the list of those that may
  std::uint32_t address = 0;  ///< IPv4, host byte order; 0: the serial line. The write key unlocks writes for it.
};

inline constexpr std::uint16_t kDefaultWriteKey = 18003;  // "FS"
inline constexpr std::int64_t kUnlocked_ns = 30'000'000'000;

/// The registers from 1000 on. Clients' threads read and write them; one other thread, the frame loop's, takes commands
/// and settings from here and never waits. One command runs at a time; until it ends, other writes are refused as busy.
class Control {
 public:
  explicit Control(std::uint16_t key = kDefaultWriteKey, const RuntimeSettings& factory = {})
      : Control(key, factory, factory) {}
  Control(std::uint16_t key, const RuntimeSettings& factory, const RuntimeSettings& current)
      : key_(key), factory_(factory), settings_(current), to_loop_(current) {}

  /// For clients' threads. Reads registers from address `first` on; all of them must exist.
  void read(int first, std::span<std::uint16_t> words, const ClientAccess& access, std::int64_t now_ns);
  /// For clients' threads. Writes all or nothing; checks in this order: address, lock, busy, values.
  Exception write(int first, std::span<const std::uint16_t> words, const ClientAccess& access, std::int64_t now_ns);

  /// For the frame loop's thread, wait-free.
  const RuntimeSettings& settings() { return to_loop_.read(); }
  std::optional<Command> take_command();  ///< a new one, if there is; after it, call finish() exactly once
  void finish(CommandResult result);
  /// A block whose exposure is longer ago than this is stalled: the firmware hangs or gets no processor time. Not so
  /// while the block reports a camera fault, which explains its age.
  void set_stale_after(std::int64_t stale_after_ns) { stale_after_ns_ = stale_after_ns; }
  bool is_stalled(const RegisterImage& image, std::int64_t now_ns) const {
    const bool is_measured = image.exposure_ns != 0 && !(image.words[0] & kCameraFault);
    return is_measured && now_ns - image.exposure_ns > stale_after_ns_;
  }
  /// Registers 1005, 1007 and 1008.
  void show_recording(std::uint16_t state, int seconds, int mb_left) {
    recording_ = state;
    recording_s_ = static_cast<std::uint16_t>(seconds);
    recording_mb_left_ = static_cast<std::uint16_t>(mb_left);
  }
  const RuntimeSettings& factory() const { return factory_; }

 private:
  Exception write_key(std::uint16_t key, std::uint32_t client, std::int64_t now_ns);
  std::int64_t unlocked_until_ns(std::uint32_t client) const;
  std::uint16_t word(int address, const ClientAccess& access, std::int64_t now_ns) const;

  static constexpr std::uint32_t kNoCommand = 0xFFFF'FFFF;
  const std::uint16_t key_;
  const RuntimeSettings factory_;
  std::mutex mutex_;  ///< between clients' threads; the frame loop never takes it
  struct Unlocked {
    std::uint32_t client = 0;
    std::int64_t until_ns = 0;
  };
  std::array<Unlocked, 16> unlocked_;  ///< when full, the next client replaces the one that expires first
  RuntimeSettings settings_;
  std::uint16_t command_ = 0, sequence_ = 0;
  TripleBuffer<RuntimeSettings> to_loop_;
  std::atomic<std::uint32_t> pending_{kNoCommand};
  std::uint16_t running_sequence_ = 0;    ///< register 1001 of the pending or running command
  std::atomic<bool> busy_{false};         ///< from the request to the result
  std::atomic<std::uint32_t> result_{0};  ///< sequence << 16 | result
  std::atomic<std::uint16_t> recording_{0}, recording_s_{0}, recording_mb_left_{0xFFFF};
  std::atomic<std::int64_t> stale_after_ns_{std::numeric_limits<std::int64_t>::max()};
};

}  // namespace finsight
