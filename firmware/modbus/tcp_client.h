// One TCP client: what has arrived from it, what it has not taken yet, and when its next request is answered.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "firmware/modbus/control.h"
#include "firmware/modbus/descriptor.h"
#include "firmware/modbus/request.h"

namespace finsight {

/// Never allocates and never waits. Times are of the steady clock.
class TcpClient {
 public:
  // A frame: transaction id (2 bytes), protocol id (2), length of the rest (2), unit id (1), PDU.
  static constexpr std::size_t kHeader = 7;
  static constexpr std::size_t kMaxFrame = kHeader + kMaxPdu;
  static constexpr std::int64_t kFrameLimit_ns = 3'000'000'000;   ///< from a frame's first byte to its last
  static constexpr std::int64_t kUnreadLimit_ns = 5'000'000'000;  ///< without taking a byte of an answer
  /// Requests that were sent before the answer to the one before them: so many at once, then so many a second, shared
  /// by all connections of an address. The others wait in the connection.
  static constexpr double kPipelinedBurst = 320, kPipelinedPerSecond = 4000;

  TcpClient() = default;
  TcpClient(Descriptor socket, const ClientAccess& access, std::int64_t idle_limit_ns, std::int64_t now_ns);

  bool is_open() const { return socket_.is_open(); }
  int fd() const { return socket_.get(); }
  const ClientAccess& access() const { return access_; }
  std::int64_t deadline_ns() const { return deadline_ns_; }  ///< it is closed after that

  // What it waits for: room for an answer, its next turn, or bytes.
  bool has_unsent() const { return unsent_end_ > unsent_begin_; }
  bool has_request() const;
  std::int64_t turn_ns() const { return turn_ns_; }  ///< its next request is answered from then on

  enum class Progress { kNone, kRequest, kEnd };
  /// Sends what is unsent; receives if there is no whole request. kRequest: request() is one. kEnd: close it.
  Progress advance(std::int64_t now_ns);

  std::span<const std::uint8_t> request() const { return {in_.data(), frame_length()}; }
  /// Sends the answer to the request, perhaps later, and drops the request. `answer` may be empty. `sharers`: the
  /// number of connections of this address. False: the connection is broken.
  bool answer(std::span<const std::uint8_t> answer, std::size_t sharers, std::int64_t now_ns);
  /// Closes without waiting for what it has not taken.
  void abort();

 private:
  std::size_t length_field() const { return static_cast<std::size_t>(in_[4] << 8 | in_[5]); }
  std::size_t frame_length() const { return kHeader - 1 + length_field(); }
  bool has_invalid_header() const;
  bool flush(std::int64_t now_ns);
  void pace(std::size_t sharers, std::int64_t now_ns);
  void set_deadline(std::int64_t now_ns);

  Descriptor socket_;
  ClientAccess access_;
  std::int64_t idle_limit_ns_ = 0, deadline_ns_ = 0;
  std::int64_t turn_ns_ = 0, credit_ns_ = 0;  ///< credit_ns_: when credit_ was counted
  double credit_ = kPipelinedBurst;
  std::size_t used_ = 0;  ///< bytes of in_
  std::size_t unsent_begin_ = 0, unsent_end_ = 0;
  std::array<std::uint8_t, 4 * kMaxFrame> in_;
  std::array<std::uint8_t, kMaxFrame> unsent_;
};

}  // namespace finsight
