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

#include "firmware/modbus/latest_image.h"
#include "firmware/modbus/reply_image.h"
#include "firmware/modbus/request.h"

namespace finsight {

namespace {

// A frame: unit (1 byte), PDU, checksum (2, low byte first).
constexpr std::size_t kChecksum = 2;
constexpr std::size_t kLargestFrame = 1 + kLargestPdu + kChecksum;

// A pause that ends a frame. The standard's 3.5 characters cannot be kept by USB adapters, which deliver in portions of
// up to 16 ms; frames that we answer are known by their length and wait for nothing.
constexpr int kPause_ms = 20;
constexpr int kReopen_ms = 1000;
constexpr std::chrono::microseconds kShortestGap{1750};  // before an answer; 3.5 characters below 19200 bits/s

std::uint16_t checksum(std::span<const std::uint8_t> bytes) {
  std::uint16_t crc = 0xFFFF;
  for (const std::uint8_t byte : bytes) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) crc = static_cast<std::uint16_t>(crc >> 1 ^ (crc & 1 ? 0xA001 : 0));
  }
  return crc;
}

bool is_whole(std::span<const std::uint8_t> frame) {
  if (frame.size() < 2 + kChecksum) return false;
  const auto body = frame.first(frame.size() - kChecksum);
  return checksum(body) == (frame[body.size()] | frame[body.size() + 1] << 8);
}

/// Lengths of the frames that we answer with data: functions 3 and 4, and identification.
std::size_t known_length(std::uint8_t function) { return function == 3 || function == 4 ? 8 : function == 43 ? 7 : 0; }

}  // namespace

struct SerialLine::Impl {
  Impl(const SerialSettings& wanted, std::function<void(const std::string&)> listener)
      : settings(wanted), report(std::move(listener)), wake(::eventfd(0, EFD_CLOEXEC)) {
    if (wake < 0) throw std::system_error(errno, std::generic_category(), "Modbus RTU");
    const auto character_us = std::chrono::microseconds(11'000'000 / settings.baud);
    gap = std::max(kShortestGap, character_us * 7 / 2);
    thread = std::thread([this] { run(); });
  }

  ~Impl() {
    ::eventfd_write(wake, 1);
    thread.join();
    ::close(wake);
  }

  void run() {
    bool told = false;
    while (!stopping) {
      if (open()) {
        tell("is open");
        told = false;
        serve();
        if (!stopping) tell("was lost; it is opened again as soon as it is there");
      } else if (!std::exchange(told, true)) {
        tell(std::string("cannot be opened (") + modbus_strerror(errno) + "); it is tried again every second");
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

  /// Waits for the device or the end of the program. Negative: the device is gone; 0: nothing came in time.
  int wait(int device, int timeout_ms) {
    pollfd polled[] = {{wake, POLLIN, 0}, {device, POLLIN, 0}};
    ::poll(polled, 2, timeout_ms);
    stopping = polled[0].revents != 0;
    if (stopping || polled[1].revents & (POLLERR | POLLHUP | POLLNVAL)) return -1;
    return polled[1].revents ? 1 : 0;
  }

  // Until the device is gone or the program ends.
  void serve() {
    const int device = modbus_get_socket(line.get());
    used = 0;
    for (;;) {
      const int ready = wait(device, used > 0 ? kPause_ms : -1);
      if (ready < 0) return;
      if (ready == 0) {  // a pause: what has come is a frame, or rubbish
        const std::span<const std::uint8_t> frame(bytes.data(), std::exchange(used, 0));
        if (is_whole(frame) && !answer(frame)) return;
        continue;
      }
      if (used == bytes.size()) used = 0;  // longer than any frame
      const ssize_t got = ::read(device, &bytes[used], bytes.size() - used);
      if (got == 0 || (got < 0 && errno != EAGAIN && errno != EINTR)) return;
      if (got > 0) used += static_cast<std::size_t>(got);
      if (!answer_request_at_the_end()) return;
    }
  }

  // Of a line with several units we also hear the others' answers, perhaps without a pause before the next request. So
  // the last bytes are looked at: our address, a function that we know, its length, and a correct checksum.
  bool answer_request_at_the_end() {
    for (const std::size_t length : {std::size_t{8}, std::size_t{7}}) {
      if (used < length) continue;
      const std::span<const std::uint8_t> frame(&bytes[used - length], length);
      if (frame[0] != settings.unit || known_length(frame[1]) != length || !is_whole(frame)) continue;
      const bool sent = answer(frame);
      used = 0;
      return sent;
    }
    return true;
  }

  /// A whole frame. False: the device does not take the answer.
  bool answer(std::span<const std::uint8_t> frame) {
    if (frame[0] != settings.unit) return true;
    std::this_thread::sleep_for(gap);
    std::array<std::uint8_t, 1 + kLargestPdu> reply;
    reply[0] = frame[0];
    const std::size_t length = answer_request(frame.subspan(1, frame.size() - 1 - kChecksum),
                                              std::span<std::uint8_t, kLargestPdu>(&reply[1], kLargestPdu));
    if (length > 0) {
      return modbus_send_raw_request(line.get(), reply.data(), static_cast<int>(1 + length)) > 0;  // adds the checksum
    }
    return reply_image(line.get(), frame, latest.read());
  }

  const SerialSettings settings;
  const std::function<void(const std::string&)> report;
  const int wake;
  std::chrono::microseconds gap;
  bool stopping = false;  // of the thread's own
  std::unique_ptr<modbus_t, decltype(&modbus_free)> line{nullptr, &modbus_free};
  std::array<std::uint8_t, kLargestFrame> bytes;
  std::size_t used = 0;
  LatestImage latest;
  std::thread thread;
};

SerialLine::SerialLine(const SerialSettings& settings, std::function<void(const std::string&)> report)
    : impl_(std::make_unique<Impl>(settings, std::move(report))) {}
SerialLine::~SerialLine() = default;
void SerialLine::publish(const RegisterImage& image) noexcept { impl_->latest.publish(image); }

}  // namespace finsight
