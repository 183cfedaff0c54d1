// Everything beside the measurements: commands and settings from clients to the frame loop, results back, the history
// of commands and diagnostics.
#pragma once

#include <atomic>
#include <cstdint>
#include <limits>
#include <mutex>
#include <optional>
#include <span>

#include "firmware/modbus/command_history.h"
#include "firmware/modbus/diagnostics.h"
#include "firmware/modbus/exception.h"
#include "firmware/modbus/registers.h"
#include "firmware/modbus/triple_buffer.h"
#include "firmware/modbus/write_lock.h"

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
  kZeroAll = value_named("command", "zero_all"),
};

/// Register 1003.
enum class CommandResult : std::uint16_t {
  kDone = value_named("result", "done"),
  kNotPossible = value_named("result", "not_possible"),
  kNotConfigured = value_named("result", "not_configured"),
  kFailed = value_named("result", "failed"),
};

/// The registers from 1000 on. Clients' threads read and write them; one other thread, the frame loop's, takes commands
/// and settings from here and never waits. One command runs at a time; until it ends, other writes are refused as busy
/// (those of the key, of register 1006 and of register 1009 are not).
class Control {
 public:
  explicit Control(std::uint16_t key = kDefaultWriteKey, const RuntimeSettings& factory = {})
      : Control(key, factory, factory) {}
  Control(std::uint16_t key, const RuntimeSettings& factory, const RuntimeSettings& current)
      : factory_(factory), lock_(key), settings_(current), to_loop_(current) {}

  // For clients' threads.

  /// Whether all of these registers exist in one block from 1000 on.
  static bool has_registers(int first, int count);
  /// Reads registers from address `first` on, all of which must exist. `stalled_since_ns` is what stalled_since_ns()
  /// says of the block of measurements that is served at the same time.
  void read(int first, std::span<std::uint16_t> words, const ClientAccess& access, std::int64_t now_ns,
            std::int64_t stalled_since_ns = 0);
  /// Writes all or nothing; checks in this order: address, lock, busy, values.
  Exception write(int first, std::span<const std::uint16_t> words, const ClientAccess& access, std::int64_t now_ns);
  RuntimeSettings settings_copy();
  void count_answer(Exception answer);  ///< kNone: no exception
  enum class Arrival { kAccepted, kReplacing, kRefused };
  void count_connection(Arrival arrival);
  void show_open_connections(std::uint32_t open);

  // For the frame loop's thread, wait-free.

  const RuntimeSettings& settings() { return to_loop_.read(); }
  std::optional<Command> take_command();  ///< a new one, if there is; after it, call finish() exactly once
  void finish(CommandResult result);
  /// Whether register 1006 was not written for longer than setting 1022 (as settings() has it) allows. The time counts
  /// from the moment at which this is first asked with the setting on.
  bool is_master_lost(std::int64_t now_ns);
  /// From now on registers 1102 to 1104 count as known for this long after each write; before, never.
  void expect_gravity(std::int64_t max_age_ns) { gravity_max_age_ns_ = max_age_ns; }
  /// In the finger frame, in g; nothing while it is not known.
  std::optional<Vec3f> felt_gravity(std::int64_t now_ns) const;
  /// A block whose exposure is longer ago than this is stalled: the firmware hangs or gets no processor time. While the
  /// block reports a camera fault, which explains its age, the time counts from its publication.
  void set_stale_after(std::int64_t stale_after_ns) { stale_after_ns_ = stale_after_ns; }
  void note_publication(std::int64_t now_ns) { published_ns_ = now_ns; }
  /// When the block became stalled; 0: it is not. For any thread.
  std::int64_t stalled_since_ns(const RegisterImage& image, std::int64_t now_ns) const;
  /// Registers 1005, 1007 and 1008.
  void show_recording(std::uint16_t state, int seconds, int mb_left) {
    recording_ = state;
    recording_s_ = static_cast<std::uint16_t>(seconds);
    recording_mb_left_ = static_cast<std::uint16_t>(mb_left);
  }
  void show_health(const LoopHealth& health) { health_.publish(health); }
  const RuntimeSettings& factory() const { return factory_; }

  // For any thread.

  void show_processor_temperature(float degc) { processor_temperature_degc_ = degc; }
  void identify(const DeviceIdentity& identity);
  GivenCommand last_finished();
  /// A reset that was ordered before: its client, who may not have seen the result, must not order it once more.
  void remember(GivenCommand reset);

 private:
  Exception write_key(std::uint16_t key, const ClientAccess& access, std::int64_t now_ns);
  Exception write_exclusive(std::uint16_t on, const ClientAccess& access);
  Exception write_command(std::uint16_t command, std::uint16_t sequence, const ClientAccess& access,
                          std::int64_t now_ns);
  void write_gravity(std::span<const std::uint16_t> words, std::int64_t now_ns);
  Exception write_settings(int first, std::span<const std::uint16_t> words);
  void settle();
  std::uint32_t exclusive_client(std::int64_t now_ns) const;
  std::uint16_t word(int address, const ClientAccess& access, std::int64_t now_ns) const;
  void read_history(std::span<std::uint16_t, kHistoryRegisters> words, const ClientAccess& access,
                    std::int64_t now_ns) const;

  static constexpr std::uint32_t kNoCommand = 0xFFFF'FFFF;
  const RuntimeSettings factory_;
  const std::int64_t started_ns_ = steady_now_ns();

  std::mutex mutex_;  ///< between clients' threads, over what follows; the frame loop never takes it
  WriteLock lock_;
  std::uint32_t exclusive_client_ = kNobody;
  RuntimeSettings settings_;
  CommandHistory history_;
  std::uint16_t refresh_ = 0;
  ServerCounts counts_;
  DeviceIdentity identity_;

  // Between clients' threads and the frame loop.
  TripleBuffer<RuntimeSettings> to_loop_;
  TripleBuffer<LoopHealth> health_{LoopHealth{}};  ///< read under the mutex
  std::atomic<std::uint32_t> pending_{kNoCommand};
  std::atomic<bool> busy_{false};         ///< from the request to the result
  std::atomic<std::uint16_t> result_{0};  ///< of the newest command, once it is not busy
  std::atomic<std::int64_t> refreshed_ns_{0};
  std::atomic<std::uint64_t> packed_gravity_{0};  ///< the three words, the first one lowest
  std::atomic<std::int64_t> gravity_ns_{0}, gravity_max_age_ns_{0};
  std::int64_t guarded_since_ns_ = 0;  ///< the frame loop's alone; 0: setting 1022 is off
  std::atomic<std::uint16_t> recording_{0}, recording_s_{0}, recording_mb_left_{0xFFFF};
  std::atomic<std::int64_t> stale_after_ns_{std::numeric_limits<std::int64_t>::max()};
  std::atomic<std::int64_t> published_ns_{0};
  std::atomic<float> processor_temperature_degc_{std::numeric_limits<float>::quiet_NaN()};
};

}  // namespace finsight
