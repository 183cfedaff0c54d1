// Modbus server: TCP in a thread of its own, RTU on a serial line in another.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "firmware/modbus/control.h"
#include "firmware/modbus/network.h"
#include "firmware/modbus/serial_line.h"
#include "firmware/types.h"

namespace finsight {

struct ModbusSettings {
  std::string address = "127.0.0.1";  ///< IPv4 address to listen on; "0.0.0.0" for all
  int port = 502;                     ///< 0: any free port
  int max_clients = 32;
  int idle_limit_s = 60;                   ///< a silent client is closed after this
  int unit = 0;                            ///< 1...247: only this unit id, 0 and 255 get an answer; 0: all of these do
  std::vector<Network> allow = {};         ///< who may connect; empty: everybody
  std::vector<Network> allow_writes = {};  ///< whose writes count once unlocked; empty: all who may connect
  std::optional<SerialSettings> serial = std::nullopt;
};

/// Serves the last published RegisterImage, and the commands and settings of `control`; before the first one, a block
/// that is not ready and has no valid value. A read of many registers is one consistent snapshot; register 3 (age) is
/// computed at the moment of the read. No client, whatever it sends or leaves unread, delays the others for longer than
/// its requests take, or allocates memory.
class ModbusServer {
 public:
  /// Opens the port; throws std::system_error naming address and port (in use, not an IPv4 address, not permitted).
  /// A serial line that cannot be opened is no error: `report` (from the line's thread) hears of it, see SerialLine.
  /// `control` must outlive the server.
  ModbusServer(const ModbusSettings& settings, Control& control,
               const std::function<void(const std::string&)>& report = {});
  ~ModbusServer();  ///< stops the thread, closes every client
  /// Wait-free, from one thread at a time.
  void publish(const RegisterImage& image) noexcept;
  int port() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace finsight
