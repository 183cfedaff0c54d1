// Records sessions: what the camera saw and what was published. Replayed by finsightd like any other session.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <semaphore>
#include <string>
#include <thread>
#include <vector>

#include "firmware/modbus/register_table.h"
#include "firmware/ports/session.h"
#include "firmware/types.h"

namespace finsight {

/// Folders session-0001, session-0002, ... The frame loop's thread hands frames over and never waits: another thread
/// writes them. Frames that it cannot write in time are left out and counted in session.toml's description. What was
/// written can be replayed, however the recording ends: session.toml says "complete = false" until it is over.
class Recorder {
 public:
  /// Register 1005.
  enum class State : std::uint16_t {
    kIdle = value_named("recording", "idle"),
    kRecording = value_named("recording", "recording"),
    kFailed = value_named("recording", "failed"),
    kFull = value_named("recording", "full"),
  };

  /// Where a recording ends by itself.
  struct Limits {
    int longest_s = 600;
    int reserve_mb = 100;  ///< of the disk, which stays free for others
  };

  /// `info` describes the images: size, rate, lens and markers.
  Recorder(std::filesystem::path folder, const SessionInfo& info, const Limits& limits);
  ~Recorder();  ///< finishes a recording that is running
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  State state() const { return state_; }
  int seconds() const { return seconds_; }  ///< length of the running or last recording
  int mb_left() const { return mb_left_; }  ///< down to the reserve; looked up every second
  /// What start() and stop() ordered is done: after stop() all files are on the disk, or the state is kFailed.
  bool is_settled() const { return open_orders_ == 0; }
  void start() { push_order(Order::kStart); }
  void stop() { push_order(Order::kStop); }
  /// Does nothing while nothing is being recorded.
  void add(const Frame& frame, const RegisterImage& image);

 private:
  enum class Order : std::uint8_t { kStart, kFrame, kStop, kEnd };
  struct Slot {
    Order order = Order::kFrame;
    std::vector<std::uint8_t> grey;
    std::uint32_t sequence = 0;
    RegisterImage image;
  };
  static constexpr unsigned kSlots = 16;     // a quarter of a second, the longest pause of a memory card
  static constexpr unsigned kForOrders = 2;  // slots that frames leave free

  void push_order(Order order);
  void push() {
    ++head_;
    filled_.release();
  }
  void run();
  void look_up_room();
  struct Session;

  const std::filesystem::path folder_;
  const SessionInfo info_;
  const Limits limits_;
  std::array<Slot, kSlots> slots_;
  std::atomic<unsigned> head_{0}, tail_{0};  ///< slots filled and written since the start
  std::atomic<int> open_orders_{0};          ///< not yet carried out
  std::atomic<unsigned> left_out_{0};
  std::atomic<State> state_{State::kIdle};
  std::atomic<int> seconds_{0}, mb_left_{0};
  std::counting_semaphore<> filled_{0};
  std::thread thread_;
};

}  // namespace finsight
