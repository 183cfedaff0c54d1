#include "firmware/modbus/request.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <string_view>

#include "firmware/types.h"

namespace finsight {

namespace {

using Request = std::span<const std::uint8_t>;
using Reply = std::span<std::uint8_t, kLargestPdu>;

enum Function : std::uint8_t { kReadHoldingRegisters = 3, kReadInputRegisters = 4, kEncapsulatedInterface = 43 };
enum Exception : std::uint8_t { kNoException = 0, kIllegalFunction = 1, kIllegalAddress = 2, kIllegalValue = 3 };

constexpr int kMostRegistersPerRead = 125;

std::size_t exception(Request request, Exception code, Reply reply) {
  reply[0] = request[0] | 0x80;
  reply[1] = code;
  return 2;
}

// Sections 6.3 and 6.4: the quantity is judged before the address.
Exception check_read(Request request) {
  if (request.size() != 5) return kIllegalValue;
  const int address = request[1] << 8 | request[2];
  const int quantity = request[3] << 8 | request[4];
  if (quantity < 1 || quantity > kMostRegistersPerRead) return kIllegalValue;
  if (address + quantity > kMeasurementRegisters) return kIllegalAddress;
  return kNoException;
}

// Section 6.21, read device identification. Objects 0...2 are basic, up to 0x7F regular.
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
constexpr std::uint8_t kRegularAndIndividualAccess = 0x82;  // conformity level: all of kIdentity, by list or one by one
constexpr std::size_t kIdentityHeader = 7;
enum ReadDeviceId : std::uint8_t { kBasic = 1, kExtended = 3, kIndividual = 4 };

// So that an answer never needs a second request ("more follows" is always 0).
static_assert([] {
  std::size_t length = kIdentityHeader;
  for (const IdentityObject& object : kIdentity) length += 2 + object.text.size();
  return length <= kLargestPdu;
}());

/// The objects that a request gets: all of its category from the one named on; one that does not exist means the first.
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
    return exception(request, kIllegalFunction, reply);
  }
  if (request.size() != 4) return exception(request, kIllegalValue, reply);
  const std::uint8_t code = request[2];
  if (code < kBasic || code > kIndividual) return exception(request, kIllegalValue, reply);
  const std::span<const IdentityObject> objects = identity_objects(code, request[3]);
  if (objects.empty()) return exception(request, kIllegalAddress, reply);

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

}  // namespace

std::size_t answer_request(Request request, Reply reply) {
  switch (request[0]) {
    case kReadHoldingRegisters:
    case kReadInputRegisters: {
      const Exception code = check_read(request);
      return code == kNoException ? 0 : exception(request, code, reply);
    }
    case kEncapsulatedInterface:
      return identify(request, reply);
    default:
      return exception(request, kIllegalFunction, reply);
  }
}

}  // namespace finsight
