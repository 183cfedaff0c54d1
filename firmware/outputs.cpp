#include "firmware/outputs.h"

#include "firmware/modbus/registers.h"

namespace finsight {

OutputLevels output_levels(std::uint16_t status, const OutputLevels& safe) {
  if (status & kAnyFault) return safe;
  return {(status & kContact) != 0, (status & kOverRange) != 0, (status & kReady) != 0};
}

}  // namespace finsight
