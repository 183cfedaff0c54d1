// libFuzzer target: no bytes on the wire make the Modbus server's request code misbehave. The input is the TCP stream
// of one client, divided into frames as the server does it; between frames, the frame loop may take a command.
//   cmake -S . -B build/fuzz -G Ninja -DFINSIGHT_FUZZ=ON -DCMAKE_CXX_COMPILER=clang++
//   cmake --build build/fuzz --target fuzz_modbus
//   build/fuzz/tests/fuzz_modbus -runs=1000000 NEW_INPUTS_FOLDER tests/fuzz/modbus_corpus
#include <algorithm>
#include <cstdlib>
#include <memory>

#include "firmware/modbus/request.h"

namespace {

using namespace finsight;

void require(bool holds) {
  if (!holds) std::abort();
}

/// Whether a response has the form that its request calls for.
bool is_well_formed(std::span<const std::uint8_t> request, std::span<const std::uint8_t> reply) {
  if (reply.size() == 2 && reply[0] == (request[0] | 0x80)) {
    return reply[1] == 1 || reply[1] == 2 || reply[1] == 3 || reply[1] == 4 || reply[1] == 6;
  }
  if (reply[0] != request[0]) return false;
  switch (reply[0]) {
    case 3:
    case 4:
    case 23:
      return reply.size() == 2U + reply[1];
    case 6:
    case 16:
      return reply.size() == 5 && std::equal(reply.begin(), reply.end(), request.begin());
    case 43:
      return reply.size() > 7 && reply[1] == 14;
    default:
      return false;
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  constexpr std::size_t kHeader = 7;
  Control control;
  TripleBuffer<RegisterImage> latest{empty_block()};
  ClientAccess access{.may_write = true, .address = 2, .connection = 1};
  std::size_t at = 0;
  while (at + kHeader < size) {
    const std::size_t length = static_cast<std::size_t>(bytes[at + 4] << 8 | bytes[at + 5]);
    if (bytes[at + 2] || bytes[at + 3] || length < 2 || length > 1 + kMaxPdu) return 0;  // the server closes
    if (at + kHeader - 1 + length > size) return 0;
    // A buffer of exactly the right size, so that the sanitizer sees any read beyond it.
    const std::unique_ptr<std::uint8_t[]> request(new std::uint8_t[length - 1]);
    std::copy_n(bytes + at + kHeader, length - 1, request.get());
    std::array<std::uint8_t, kMaxPdu> reply;
    const std::span<const std::uint8_t> asked(request.get(), length - 1);
    const std::size_t answered = answer_request(asked, view_now(latest, control), access, reply);
    require(answered >= 2 && answered <= kMaxPdu && is_well_formed(asked, {reply.data(), answered}));
    require(are_valid(control.settings()));
    // The transaction id decides whether the frame loop takes a command now, and what its result is.
    if (const auto command = bytes[at] & 1 ? control.take_command() : std::nullopt) {
      require(static_cast<std::uint16_t>(*command) <= control_row(kCommandRegister).highest);
      control.finish(static_cast<CommandResult>(bytes[at + 1] & 3));
    }
    // The unit decides whether the client goes and comes back, or another one of its address takes over.
    if (bytes[at + 6] & 0x60) ++access.connection;
    at += kHeader - 1 + length;
  }
  return 0;
}
