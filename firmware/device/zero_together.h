// Command 14: one finger's loop orders a zero of all others, whose loops run in threads of their own.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "firmware/modbus/register_table.h"

namespace finsight {

/// Who has ordered it of whom, and what came of it. Neither allocates nor waits.
class ZeroTogether {
 public:
  explicit ZeroTogether(std::size_t fingers) : fingers_(fingers) {}

  void order(std::size_t from) {
    for (std::size_t to = 0; to < fingers_; ++to) orders_[from][to] = to == from ? State::kDone : State::kOrdered;
  }
  /// Whether a zero is ordered of finger `to`, which must then begin one, and tell() its outcome once.
  bool take(std::size_t to) {
    bool taken = false;
    for (std::size_t from = 0; from < fingers_; ++from) {
      State expected = State::kOrdered;
      taken |= orders_[from][to].compare_exchange_strong(expected, State::kTaken);
    }
    return taken;
  }
  void tell(std::size_t to, bool done) {
    for (std::size_t from = 0; from < fingers_; ++from) {
      State expected = State::kTaken;
      orders_[from][to].compare_exchange_strong(expected, done ? State::kDone : State::kNotPossible);
    }
  }
  /// Whether all others have a new zero; nothing while one of them is not over.
  std::optional<bool> outcome(std::size_t from) const {
    bool done = true;
    for (std::size_t to = 0; to < fingers_; ++to) {
      const State state = orders_[from][to];
      if (state == State::kOrdered || state == State::kTaken) return std::nullopt;
      done = done && state == State::kDone;
    }
    return done;
  }

 private:
  enum class State : std::uint8_t { kDone, kNotPossible, kOrdered, kTaken };
  const std::size_t fingers_;
  std::array<std::array<std::atomic<State>, kMostFingers>, kMostFingers> orders_{};  ///< [from][to]
};

}  // namespace finsight
