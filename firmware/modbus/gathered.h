// The block that gathers all fingers of a device (2000 on), so that a PLC polls once.
#pragma once

#include <cstdint>
#include <span>

#include "firmware/modbus/register_table.h"
#include "firmware/types.h"

namespace finsight {

/// Writes the whole block from the fingers' own blocks, 1 to 4 of them in their order, each with its age and marked if
/// it is stalled. All were taken at the same time, so one read is one moment.
void write_gathered(std::span<const RegisterImage> fingers, std::span<std::uint16_t, kGatheredRegisters> words);

}  // namespace finsight
