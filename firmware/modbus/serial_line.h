// Modbus RTU (Modbus over Serial Line V1.02) on one serial device, in a thread of its own. Only serial_line.cpp
// includes libmodbus.
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "firmware/modbus/control.h"
#include "firmware/types.h"

namespace finsight {

struct SerialSettings {
  std::string device;  ///< such as /dev/ttyUSB0
  int baud = 19200;    ///< bits per second
  char parity = 'E';   ///< 'E', 'O' or 'N'
  int stop_bits = 1;   ///< the standard asks for 2 without parity
  int unit = 1;        ///< address of the first finger on the line, 1 to 247; the others' follow it
  /// The kernel's driver switches the transmitter (TIOCSRS485). Most adapters do it by themselves and need false.
  bool rs485 = false;
};

/// Answers requests to our units, one per finger, from the latest published RegisterImage and from its Control, and
/// carries out broadcast writes (unit 0, functions 6 and 16) at every finger without an answer. While the device is
/// missing, opens it again every second. Drops whatever is not a whole request with a correct checksum, as the standard
/// says.
class SerialLine {
 public:
  /// `report` gets one sentence when the device has been opened, cannot be opened (once) or has been lost; it is called
  /// from the line's thread. `first`: what is served until something is published. The controls must outlive the line.
  SerialLine(const SerialSettings& settings, std::span<Control* const> controls, const RegisterImage& first,
             std::function<void(const std::string&)> report);
  ~SerialLine();
  /// Wait-free, from one thread at a time for each finger.
  void publish(const RegisterImage& image, std::size_t finger) noexcept;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace finsight
