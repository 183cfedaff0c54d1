// What the PLC is told about a frame as a whole: which fault it has.
#pragma once

#include "firmware/modbus/registers.h"
#include "firmware/types.h"

namespace finsight {

/// The fault to show; of several the one that explains the others. `hold_is_over`: nothing is held any more; `lasting`:
/// shown if the frame itself has no fault.
FaultCode fault_of(const Observation& seen, bool hold_is_over, const FingerShape& shape, FaultCode lasting);

}  // namespace finsight
