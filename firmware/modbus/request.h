// What a Modbus request gets, decided before anything acts on it. Bytes in, bytes out: the same for every transport.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace finsight {

inline constexpr std::size_t kLargestPdu = 253;  ///< function code and data (Modbus Application Protocol, section 4.1)

/// Answers a request by what its function code and fields say: identification (43/14), or the exception that the Modbus
/// Application Protocol V1.1b3 names. Returns the length of the reply. 0: this is a read (functions 3 and 4) of 1...125
/// registers inside the measurement block, which may be given to libmodbus; nothing else may. `request` has 1...253
/// bytes of any content.
std::size_t answer_request(std::span<const std::uint8_t> request, std::span<std::uint8_t, kLargestPdu> reply);

}  // namespace finsight
