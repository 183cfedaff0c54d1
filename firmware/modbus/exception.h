// Exception codes of the Modbus Application Protocol V1.1b3, section 7.
#pragma once

#include <cstdint>

namespace finsight {

enum class Exception : std::uint8_t {
  kNone = 0,
  kIllegalFunction = 1,
  kIllegalAddress = 2,  ///< also "the combination of reference number and transfer length is invalid"
  kIllegalValue = 3,
  /// A write that the lock refuses. The state diagrams of functions 6 and 16 (sections 6.6 and 6.12) give code 4 to a
  /// write of existing registers and allowed values that is not carried out; code 1 would read as "no such function".
  kLocked = 4,
  kBusy = 6,
  kNoSuchFinger = 11  ///< gateway target device failed to respond: a unit id beside those of the device's fingers
};

}  // namespace finsight
