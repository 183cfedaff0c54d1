// Modbus server: TCP in a thread of its own, RTU on a serial line in another. The only folder that sees libmodbus.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "firmware/modbus/serial_line.h"
#include "firmware/types.h"

namespace finsight {

struct ModbusSettings {
  std::string address = "127.0.0.1";  ///< IPv4 address to listen on; "0.0.0.0" for all
  int port = 502;                     ///< 0: any free port
  int max_clients = 32;
  int idle_limit_s = 60;  ///< a silent client is closed after this
  std::optional<SerialSettings> serial = std::nullopt;
};

/// Serves the last published RegisterImage; before the first one, a block that is not ready and has no valid value. A
/// read of many registers is one consistent snapshot; register 3 (age) is computed at the moment of the read. No
/// client, whatever it sends or leaves unread, delays the others for longer than its requests take, or allocates
/// memory.
class ModbusServer {
 public:
  /// Opens the port; throws std::system_error naming address and port (in use, not an IPv4 address, not permitted).
  /// A serial line that cannot be opened is no error: `report` (from the line's thread) hears of it, see SerialLine.
  explicit ModbusServer(const ModbusSettings& settings, const std::function<void(const std::string&)>& report = {});
  ~ModbusServer();  ///< stops the thread, closes every client
  /// Wait-free, from one thread at a time.
  void publish(const RegisterImage& image) noexcept;
  int port() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace finsight
