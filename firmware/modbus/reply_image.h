// The answer to a read of registers, on whatever line it came.
#pragma once

#include <modbus.h>

#include <cstdint>
#include <span>

#include "firmware/types.h"

namespace finsight {

/// Answers a whole frame with function 3 or 4; both show the same block. False: it could not be sent whole.
inline bool reply_image(modbus_t* line, std::span<const std::uint8_t> frame, RegisterImage image) {
  modbus_mapping_t mapping{};
  mapping.nb_registers = mapping.nb_input_registers = kMeasurementRegisters;
  mapping.tab_registers = mapping.tab_input_registers = image.words.data();
  return modbus_reply(line, frame.data(), static_cast<int>(frame.size()), &mapping) > 0;
}

}  // namespace finsight
