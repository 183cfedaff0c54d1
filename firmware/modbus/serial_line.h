// Modbus RTU (Modbus over Serial Line V1.02) on one serial device, in a thread of its own. The only place that sees
// libmodbus.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "firmware/modbus/control.h"
#include "firmware/types.h"

namespace finsight {

struct SerialSettings {
  std::string device;  ///< such as /dev/ttyUSB0
  int baud = 19200;    ///< bits per second
  char parity = 'E';   ///< 'E', 'O' or 'N'
  int stop_bits = 1;   ///< the standard wants 2 when there is no parity
  int unit = 1;        ///< our address on the line: 1...247
  bool rs485 =
      false;  ///< the kernel's driver switches the transmitter (TIOCSRS485); adapters that do it alone need not
};

/// Answers requests to our unit from the last published RegisterImage and `control`, and carries out broadcast writes
/// (unit 0, functions 6 and 16) without an answer. A device that is missing or vanishes is opened again every second.
/// What is not a whole request with a correct checksum is dropped as the standard says, without an answer.
class SerialLine {
 public:
  /// `report` hears in one sentence when the device is open, and once when it cannot be opened or is lost.
  /// `control` must outlive the line.
  SerialLine(const SerialSettings& settings, Control& control, std::function<void(const std::string&)> report);
  ~SerialLine();
  /// Wait-free, from one thread at a time.
  void publish(const RegisterImage& image) noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace finsight
