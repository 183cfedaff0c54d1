#include "firmware/modbus/serial_line.h"

#include <modbus.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <span>
#include <system_error>
#include <thread>
#include <utility>

#include "firmware/modbus/request.h"

namespace finsight {

namespace {

// A frame: unit (1 byte), PDU, checksum (2, low byte first).
constexpr std::size_t kChecksum = 2;
constexpr std::size_t kMaxFrame = 1 + kMaxPdu + kChecksum;

// Silence that ends a frame. The standard's 3.5 characters are of no use with USB adapters, which deliver in chunks up
// to 16 ms apart. Requests that we answer are recognised by their length and do not wait for the silence.
constexpr int kSilence_ms = 20;
constexpr int kReopen_ms = 1000;
constexpr std::chrono::microseconds kMinGap{1750};  // before an answer; 3.5 characters if those are longer

std::uint16_t checksum(std::span<const std::uint8_t> bytes) {
  std::uint16_t crc = 0xFFFF;
  for (const std::uint8_t byte : bytes) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) crc = static_cast<std::uint16_t>(crc >> 1 ^ (crc & 1 ? 0xA001 : 0));
  }
  return crc;
}

bool has_correct_checksum(std::span<const std::uint8_t> frame) {
  if (frame.size() < 2 + kChecksum) return false;
  const auto body = frame.first(frame.size() - kChecksum);
  return checksum(body) == (frame[body.size()] | frame[body.size() + 1] << 8);
}

/// The length of the request that begins with these bytes; 0 if it is not known (yet).
std::size_t request_length(std::span<const std::uint8_t> begin) {
  const auto counted = [&](std::size_t count_at) {
    return begin.size() > count_at ? count_at + 1 + begin[count_at] + kChecksum : 0;
  };
  switch (begin.size() > 1 ? begin[1] : 0) {
    case 3:
    case 4:
    case 6:
      return 8;
    case 16:
      return counted(6);
    case 23:
      return counted(10);
    case 43:
      return 7;
    default:
      return 0;
  }
}

bool is_broadcast_write(std::uint8_t function) { return function == 6 || function == 16; }

}  // namespace

struct SerialLine::Impl {
  Impl(const SerialSettings& wanted, std::span<Control* const> controls, const RegisterImage& first,
       std::function<void(const std::string&)> listener)
      : settings(wanted), fingers(controls, first), report(std::move(listener)), wake(::eventfd(0, EFD_CLOEXEC)) {
    if (wake < 0) throw std::system_error(errno, std::generic_category(), "Modbus RTU");
    const auto character_us = std::chrono::microseconds(11'000'000 / settings.baud);
    gap = std::max(kMinGap, character_us * 7 / 2);
    thread = std::thread([this] { run(); });
  }

  ~Impl() {
    ::eventfd_write(wake, 1);
    thread.join();
    ::close(wake);
  }

  void run() {
    bool is_reported = false;
    while (!stopping) {
      if (open()) {
        tell("is open");
        is_reported = false;
        serve();
        if (!stopping) tell("was lost; it will be opened again as soon as it is back");
      } else if (!std::exchange(is_reported, true)) {
        tell(std::string("cannot be opened (") + modbus_strerror(errno) + "); trying again every second");
      }
      line.reset();
      if (!stopping) wait(-1, kReopen_ms);
    }
  }

  bool open() {
    line.reset(modbus_new_rtu(settings.device.c_str(), settings.baud, settings.parity, 8, settings.stop_bits));
    if (!line || modbus_set_slave(line.get(), settings.unit) < 0 || modbus_connect(line.get()) < 0) return false;
    return !settings.rs485 || modbus_rtu_set_serial_mode(line.get(), MODBUS_RTU_RS485) == 0;
  }

  void tell(const std::string& what) const {
    if (report) report("Modbus RTU: " + settings.device + " " + what);
  }

  /// Waits for bytes. Returns 1 if there are some, 0 if none came in time, -1 if the device is gone or the program
  /// ends.
  int wait(int device, int timeout_ms) {
    pollfd polled[] = {{wake, POLLIN, 0}, {device, POLLIN, 0}};
    ::poll(polled, 2, timeout_ms);
    stopping = polled[0].revents != 0;
    if (stopping || polled[1].revents & (POLLERR | POLLHUP | POLLNVAL)) return -1;
    return polled[1].revents ? 1 : 0;
  }

  /// Returns when the device is gone or the program ends.
  void serve() {
    const int device = modbus_get_socket(line.get());
    used = 0;
    for (;;) {
      const int ready = wait(device, used > 0 ? kSilence_ms : -1);
      if (ready < 0) return;
      if (ready == 0) {  // silence: what has arrived is a frame or noise
        const std::span<const std::uint8_t> frame(bytes.data(), std::exchange(used, 0));
        if (has_correct_checksum(frame) && !answer(frame)) return;
        continue;
      }
      if (used == bytes.size()) used = 0;  // longer than any frame
      const ssize_t got = ::read(device, &bytes[used], bytes.size() - used);
      if (got == 0 || (got < 0 && errno != EAGAIN && errno != EINTR)) return;
      if (got > 0) used += static_cast<std::size_t>(got);
      if (!answer_early()) return;
    }
  }

  // A request of known length is answered without waiting for silence. On a line with several units we also receive the
  // others' answers, perhaps without a gap before the next request. So not only all bytes since the last silence may be
  // a request, but also the last 8 or 7 of them: with our address, a function of that length, and a correct checksum.
  bool answer_early() {
    const std::span<const std::uint8_t> all(bytes.data(), used);
    for (const std::size_t length : {used, std::size_t{8}, std::size_t{7}}) {
      if (used < length || length < 2) continue;
      const auto frame = all.last(length);
      const bool for_us = is_ours(frame[0]) || (frame[0] == 0 && length == used);
      if (!for_us || request_length(frame) != length || !has_correct_checksum(frame)) continue;
      used = 0;
      return answer(frame);
    }
    return true;
  }

  bool is_ours(std::uint8_t unit) const {
    return unit >= settings.unit && unit < settings.unit + static_cast<int>(fingers.count());
  }

  /// Answers a whole frame if it is for us. False: the answer could not be sent.
  bool answer(std::span<const std::uint8_t> frame) {
    std::array<std::uint8_t, 1 + kMaxPdu> reply;
    const auto pdu = frame.subspan(1, frame.size() - 1 - kChecksum);
    const auto carry_out = [&](std::size_t finger) {
      return answer_request(pdu, fingers.view(finger), access, std::span<std::uint8_t, kMaxPdu>(&reply[1], kMaxPdu));
    };
    if (frame[0] == 0 && is_broadcast_write(frame[1])) {
      for (std::size_t finger = 0; finger < fingers.count(); ++finger) carry_out(finger);
      return true;
    }
    if (!is_ours(frame[0])) return true;
    std::this_thread::sleep_for(gap);
    reply[0] = frame[0];
    const std::size_t length = carry_out(static_cast<std::size_t>(frame[0] - settings.unit));
    return modbus_send_raw_request(line.get(), reply.data(), static_cast<int>(1 + length)) > 0;  // adds the checksum
  }

  const SerialSettings settings;
  ServedFingers fingers;
  ClientAccess access{.may_write = true, .address = kSerialLineClient};  // whoever is wired to the line may write
  const std::function<void(const std::string&)> report;
  const int wake;
  std::chrono::microseconds gap;
  bool stopping = false;  // used by the thread only
  std::unique_ptr<modbus_t, decltype(&modbus_free)> line{nullptr, &modbus_free};
  std::array<std::uint8_t, kMaxFrame> bytes;
  std::size_t used = 0;
  std::thread thread;
};

SerialLine::SerialLine(const SerialSettings& settings, std::span<Control* const> controls, const RegisterImage& first,
                       std::function<void(const std::string&)> report)
    : impl_(std::make_unique<Impl>(settings, controls, first, std::move(report))) {}
SerialLine::~SerialLine() = default;
void SerialLine::publish(const RegisterImage& image, std::size_t finger) noexcept {
  impl_->fingers.publish(finger, image);
}

}  // namespace finsight
