// What the PLC is told about a frame as a whole: which fault it has.
#pragma once

#include "firmware/modbus/registers.h"
#include "firmware/types.h"

namespace finsight {

/// The first fault that holds; what explains another comes before it. `hold_is_over`: nothing is held any more;
/// `lasting`: shown where the frame itself has none.
FaultCode fault_of(const Observation& seen, bool hold_is_over, const FingerShape& shape, FaultCode lasting);

}  // namespace finsight
