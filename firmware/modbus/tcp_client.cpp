#include "firmware/modbus/tcp_client.h"

#include <sys/socket.h>

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <utility>

namespace finsight {

TcpClient::TcpClient(Descriptor socket, const ClientAccess& access, std::int64_t idle_limit_ns, std::int64_t now_ns)
    : socket_(std::move(socket)),
      access_(access),
      idle_limit_ns_(idle_limit_ns),
      deadline_ns_(now_ns + idle_limit_ns),
      credit_ns_(now_ns) {}

bool TcpClient::has_request() const { return used_ >= kHeader && used_ >= frame_length(); }

bool TcpClient::has_invalid_header() const {
  const bool is_modbus = in_[2] == 0 && in_[3] == 0;
  return used_ >= kHeader && !(is_modbus && length_field() >= 2 && length_field() <= 1 + kMaxPdu);
}

TcpClient::Progress TcpClient::advance(std::int64_t now_ns) {
  if (has_unsent() && !flush(now_ns)) return Progress::kEnd;
  if (has_unsent()) return Progress::kNone;
  if (!has_request()) {
    const bool is_new_frame = used_ == 0;
    const ssize_t got = ::recv(socket_.get(), &in_[used_], in_.size() - used_, 0);
    if (got < 0) return errno == EAGAIN || errno == EINTR ? Progress::kNone : Progress::kEnd;
    if (got == 0) return Progress::kEnd;
    // The time limit of a frame starts with its first byte and is not extended by further bytes.
    if (is_new_frame) deadline_ns_ = std::min(deadline_ns_, now_ns + kFrameLimit_ns);
    used_ += static_cast<std::size_t>(got);
  }
  if (has_invalid_header()) return Progress::kEnd;
  return has_request() && now_ns >= turn_ns_ ? Progress::kRequest : Progress::kNone;
}

bool TcpClient::answer(std::span<const std::uint8_t> answer, std::size_t sharers, std::int64_t now_ns) {
  assert(!has_unsent() && answer.size() <= unsent_.size());
  const std::size_t length = frame_length();
  std::copy(in_.begin() + static_cast<std::ptrdiff_t>(length), in_.begin() + static_cast<std::ptrdiff_t>(used_),
            in_.begin());
  used_ -= length;
  if (used_ > 0) pace(sharers, now_ns);
  std::ranges::copy(answer, unsent_.begin());
  unsent_begin_ = 0;
  unsent_end_ = answer.size();
  if (answer.empty()) {
    set_deadline(now_ns);
    return true;
  }
  deadline_ns_ = now_ns + kUnreadLimit_ns;
  return flush(now_ns);
}

void TcpClient::set_deadline(std::int64_t now_ns) {
  const bool has_begun_frame = used_ > 0 && !has_request();
  deadline_ns_ = now_ns + (has_begun_frame ? std::min(idle_limit_ns_, kFrameLimit_ns) : idle_limit_ns_);
}

/// Sends what the kernel takes; then the rest waits, and no further request is read.
bool TcpClient::flush(std::int64_t now_ns) {
  const ssize_t sent = ::send(socket_.get(), &unsent_[unsent_begin_], unsent_end_ - unsent_begin_, MSG_NOSIGNAL);
  if (sent < 0) return errno == EAGAIN || errno == EINTR;
  unsent_begin_ += static_cast<std::size_t>(sent);
  if (has_unsent()) {
    deadline_ns_ = now_ns + kUnreadLimit_ns;
  } else {
    set_deadline(now_ns);
  }
  return true;
}

// A bucket of credit that fills with time. Once it is empty, the turn comes when there is credit for several requests,
// so that a client that sends without pause does not cost a wake-up per request.
void TcpClient::pace(std::size_t sharers, std::int64_t now_ns) {
  constexpr double kRequestsPerTurn = 8, kNsPerSecond = 1e9;
  const double per_ns = kPipelinedPerSecond / kNsPerSecond / static_cast<double>(std::max<std::size_t>(sharers, 1));
  credit_ = std::min(credit_ + per_ns * static_cast<double>(now_ns - credit_ns_), kPipelinedBurst) - 1;
  credit_ns_ = now_ns;
  if (credit_ < 0) turn_ns_ = now_ns + static_cast<std::int64_t>((kRequestsPerTurn - credit_) / per_ns);
}

void TcpClient::abort() {
  const linger at_once{1, 0};
  ::setsockopt(socket_.get(), SOL_SOCKET, SO_LINGER, &at_once, sizeof at_once);
  socket_.close();
}

}  // namespace finsight
