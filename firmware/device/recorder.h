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

#include "firmware/ports/session.h"
#include "firmware/types.h"

namespace finsight {

/// Folders session-0001, session-0002, ... The frame loop's thread gives frames away and never waits: a thread writes
/// them, and what it cannot write in time is left out and counted in session.toml's description.
class Recorder {
 public:
  enum class State : std::uint16_t { kIdle, kRecording, kFailed };  // the values of register 1005

  /// `info` is what the images are seen through; it has a size and a rate.
  Recorder(std::filesystem::path folder, const SessionInfo& info);
  ~Recorder();  ///< ends a recording that runs
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  State state() const { return state_; }
  /// What start() and stop() began is over.
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
  static constexpr unsigned kSlots = 16;     // a quarter of a second: as long as a card may pause
  static constexpr unsigned kForOrders = 2;  // slots that frames leave free

  void push_order(Order order);
  void push() {
    ++head_;
    filled_.release();
  }
  void run();
  struct Session;

  const std::filesystem::path folder_;
  const SessionInfo info_;
  std::array<Slot, kSlots> slots_;
  std::atomic<unsigned> head_{0}, tail_{0};  ///< of the slots, counted on
  std::atomic<int> open_orders_{0};          ///< given, not yet carried out
  std::atomic<unsigned> left_out_{0};
  std::atomic<State> state_{State::kIdle};
  std::counting_semaphore<> filled_{0};
  std::thread thread_;
};

}  // namespace finsight
