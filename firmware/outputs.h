// What the digital outputs say, from the status word that clients read.
#pragma once

#include <cstdint>

#include "firmware/ports/gpio.h"

namespace finsight {

/// `status` is register 0. With any fault the safe levels; else contact and overload follow their bits, and healthy
/// means ready.
OutputLevels output_levels(std::uint16_t status, const OutputLevels& safe);

}  // namespace finsight
