// What one core can do at best: multiply-adds and bytes in a second, measured beside the methods.
#pragma once

namespace finsight::host {

struct MachineLimit {
  double multiply_adds_per_us = 0;  ///< float, in registers, with the vectors of the shape solver
  double cache_bytes_per_us = 0;    ///< read from 512 kB again and again
  double memory_bytes_per_us = 0;   ///< read from 64 MB
};

/// The best of several tries. About half a second.
MachineLimit measure_machine_limit();

}  // namespace finsight::host
