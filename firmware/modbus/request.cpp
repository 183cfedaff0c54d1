#include "firmware/modbus/request.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <string_view>

#include "firmware/modbus/gathered.h"

namespace finsight {

namespace {

using Request = std::span<const std::uint8_t>;
using Reply = std::span<std::uint8_t, kMaxPdu>;

enum Function : std::uint8_t {
  kReadHoldingRegisters = 3,
  kReadInputRegisters = 4,
  kWriteSingleRegister = 6,
  kWriteMultipleRegisters = 16,
  kReadWriteMultipleRegisters = 23,
  kEncapsulatedInterface = 43
};

constexpr int kMaxRegistersPerRead = 125;
constexpr int kMaxRegistersPerWrite = 123;      // by function 16
constexpr int kMaxRegistersPerReadWrite = 121;  // written by function 23

std::size_t exception(Request request, Exception code, Reply reply) {
  reply[0] = request[0] | 0x80;
  reply[1] = static_cast<std::uint8_t>(code);
  return 2;
}

int word_at(Request request, std::size_t at) { return request[at] << 8 | request[at + 1]; }

/// Sections 6.3 and 6.4: the quantity is checked before the address.
Exception check_read(int address, int quantity) {
  if (quantity < 1 || quantity > kMaxRegistersPerRead) return Exception::kIllegalValue;
  const bool is_gathered = address >= kGatheredAddress && address + quantity <= kGatheredAddress + kGatheredRegisters;
  const bool exists =
      address + quantity <= kMeasurementRegisters || is_gathered || Control::has_registers(address, quantity);
  return exists ? Exception::kNone : Exception::kIllegalAddress;
}

/// All fingers at the time of this request.
void read_gathered(int address, std::span<std::uint16_t> words, const DeviceView& device) {
  std::array<RegisterImage, kMostFingers> images;
  const std::size_t count = device.all ? device.all->count() : 1;
  for (std::size_t i = 0; i < count; ++i) {
    images[i] = device.all ? device.all->view(i, device.now_ns).image : device.image;
  }
  std::array<std::uint16_t, kGatheredRegisters> block;
  write_gathered({images.data(), count}, block);
  std::copy_n(block.begin() + (address - kGatheredAddress), words.size(), words.begin());
}

/// The response of function 3, 4 or 23; the registers exist.
std::size_t reply_words(Request request, int address, int quantity, const DeviceView& device,
                        const ClientAccess& access, Reply reply) {
  std::array<std::uint16_t, kMaxRegistersPerRead> buffer;
  const std::span<std::uint16_t> words(buffer.data(), static_cast<std::size_t>(quantity));
  if (address < kMeasurementRegisters) {
    // The word order that was set last, also if the block is older than that.
    RegisterImage image = device.image;
    use_word_order(image, has_low_word_first(device.control.settings_copy()));
    std::copy_n(image.words.begin() + address, quantity, words.begin());
  } else if (address >= kGatheredAddress && address < kGatheredAddress + kGatheredRegisters) {
    read_gathered(address, words, device);
  } else {
    device.control.read(address, words, access, device.now_ns, device.stalled_since_ns);
  }
  // What the process helpers read is part of the image; their settings are not.
  const int process_end = kProcessAddress + kProcessBlockRegisters;
  for (int at = std::max(address, kProcessValueAddress); at < std::min(address + quantity, process_end); ++at) {
    words[static_cast<std::size_t>(at - address)] =
        device.image.process[static_cast<std::size_t>(at - kProcessValueAddress)];
  }
  reply[0] = request[0];
  reply[1] = static_cast<std::uint8_t>(2 * quantity);
  std::size_t end = 2;
  for (const std::uint16_t word : words) {
    reply[end++] = static_cast<std::uint8_t>(word >> 8);
    reply[end++] = static_cast<std::uint8_t>(word);
  }
  return end;
}

/// Writes the words that the request holds from byte `at` on.
Exception write_words(Request request, std::size_t at, int address, int quantity, const DeviceView& device,
                      const ClientAccess& access) {
  std::array<std::uint16_t, kMaxRegistersPerWrite> words;
  for (int i = 0; i < quantity; ++i) {
    words[static_cast<std::size_t>(i)] =
        static_cast<std::uint16_t>(word_at(request, at + 2 * static_cast<std::size_t>(i)));
  }
  return device.control.write(address, {words.data(), static_cast<std::size_t>(quantity)}, access, device.now_ns);
}

/// Sections 6.6 and 6.12: the first five bytes are echoed.
std::size_t reply_written(Request request, Exception code, Reply reply) {
  if (code != Exception::kNone) return exception(request, code, reply);
  std::copy_n(request.begin(), 5, reply.begin());
  return 5;
}

std::size_t read(Request request, const DeviceView& device, const ClientAccess& access, Reply reply) {
  if (request.size() != 5) return exception(request, Exception::kIllegalValue, reply);
  const int address = word_at(request, 1), quantity = word_at(request, 3);
  const Exception code = check_read(address, quantity);
  if (code != Exception::kNone) return exception(request, code, reply);
  return reply_words(request, address, quantity, device, access, reply);
}

std::size_t write_one(Request request, const DeviceView& device, const ClientAccess& access, Reply reply) {
  if (request.size() != 5) return exception(request, Exception::kIllegalValue, reply);
  return reply_written(request, write_words(request, 3, word_at(request, 1), 1, device, access), reply);
}

std::size_t write_many(Request request, const DeviceView& device, const ClientAccess& access, Reply reply) {
  constexpr std::size_t kHeader = 6;
  const int quantity = request.size() < kHeader ? 0 : word_at(request, 3);
  if (quantity < 1 || quantity > kMaxRegistersPerWrite || request[5] != 2 * quantity ||
      request.size() != kHeader + request[5]) {
    return exception(request, Exception::kIllegalValue, reply);
  }
  const int address = word_at(request, 1);
  return reply_written(request, write_words(request, kHeader, address, quantity, device, access), reply);
}

/// Section 6.17: the write comes first. The read is checked before it, so that a request is never half carried out.
std::size_t read_and_write(Request request, const DeviceView& device, const ClientAccess& access, Reply reply) {
  constexpr std::size_t kHeader = 10;
  const int quantity = request.size() < kHeader ? 0 : word_at(request, 7);
  if (quantity < 1 || quantity > kMaxRegistersPerReadWrite || request[9] != 2 * quantity ||
      request.size() != kHeader + request[9]) {
    return exception(request, Exception::kIllegalValue, reply);
  }
  const int read_address = word_at(request, 1), read_quantity = word_at(request, 3);
  Exception code = check_read(read_address, read_quantity);
  if (code == Exception::kNone) {
    code = write_words(request, kHeader, word_at(request, 5), quantity, device, access);
  }
  if (code != Exception::kNone) return exception(request, code, reply);
  return reply_words(request, read_address, read_quantity, device, access, reply);
}

// Section 6.21, read device identification. Objects 0 to 2 are basic, those up to 0x7F regular.
struct IdentityObject {
  std::uint8_t id;
  std::string_view text;
};
constexpr IdentityObject kIdentity[] = {
    {0x00, "Finsight"},               // vendor name
    {0x01, "FS-1"},                   // product code
    {0x02, FINSIGHT_VERSION},         // revision
    {0x04, "Finsight touch sensor"},  // product name
    {0x05, "FS-1 in-finger vision"},  // model name
};
constexpr std::uint8_t kReadDeviceIdentification = 14;
constexpr std::uint8_t kRegularAndIndividualAccess = 0x82;  // conformity level: kIdentity as a list or one by one
constexpr std::size_t kIdentityHeader = 7;
enum ReadDeviceId : std::uint8_t { kBasic = 1, kExtended = 3, kIndividual = 4 };

// All objects fit into one response, so "more follows" is always 0.
static_assert([] {
  std::size_t length = kIdentityHeader;
  for (const IdentityObject& object : kIdentity) length += 2 + object.text.size();
  return length <= kMaxPdu;
}());

/// The objects that a request gets: those of its category from `object_id` on, or from the first if that does not
/// exist.
std::span<const IdentityObject> identity_objects(std::uint8_t code, std::uint8_t object_id) {
  const auto last = std::find_if(std::begin(kIdentity), std::end(kIdentity),
                                 [&](const IdentityObject& object) { return code == kBasic && object.id > 2; });
  const auto named =
      std::find_if(std::begin(kIdentity), last, [&](const IdentityObject& object) { return object.id == object_id; });
  if (code == kIndividual) return {named, named == last ? 0U : 1U};
  return {named == last ? std::begin(kIdentity) : named, last};
}

std::size_t identify(Request request, Reply reply) {
  if (request.size() < 2 || request[1] != kReadDeviceIdentification) {
    return exception(request, Exception::kIllegalFunction, reply);
  }
  if (request.size() != 4) return exception(request, Exception::kIllegalValue, reply);
  const std::uint8_t code = request[2];
  if (code < kBasic || code > kIndividual) return exception(request, Exception::kIllegalValue, reply);
  const std::span<const IdentityObject> objects = identity_objects(code, request[3]);
  if (objects.empty()) return exception(request, Exception::kIllegalAddress, reply);

  const std::array<std::uint8_t, kIdentityHeader> header = {kEncapsulatedInterface,
                                                            kReadDeviceIdentification,
                                                            code,
                                                            kRegularAndIndividualAccess,
                                                            0,  // more follows
                                                            0,  // next object
                                                            static_cast<std::uint8_t>(objects.size())};
  auto end = std::copy(header.begin(), header.end(), reply.begin());
  for (const IdentityObject& object : objects) {
    *end++ = object.id;
    *end++ = static_cast<std::uint8_t>(object.text.size());
    end = std::copy(object.text.begin(), object.text.end(), end);
  }
  return static_cast<std::size_t>(end - reply.begin());
}

std::size_t answer(Request request, const DeviceView& device, const ClientAccess& access, Reply reply) {
  switch (request[0]) {
    case kReadHoldingRegisters:
    case kReadInputRegisters:
      return read(request, device, access, reply);
    case kWriteSingleRegister:
      return write_one(request, device, access, reply);
    case kWriteMultipleRegisters:
      return write_many(request, device, access, reply);
    case kReadWriteMultipleRegisters:
      return read_and_write(request, device, access, reply);
    case kEncapsulatedInterface:
      return identify(request, reply);
    default:
      return exception(request, Exception::kIllegalFunction, reply);
  }
}

}  // namespace

std::size_t answer_request(Request request, const DeviceView& device, const ClientAccess& access, Reply reply) {
  const std::size_t length = answer(request, device, access, reply);
  device.control.count_answer(reply[0] & 0x80 ? static_cast<Exception>(reply[1]) : Exception::kNone);
  return length;
}

}  // namespace finsight
