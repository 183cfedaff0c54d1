// The Modbus server: TCP in a thread of its own, RTU on a serial line in another.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "firmware/modbus/control.h"
#include "firmware/modbus/network.h"
#include "firmware/modbus/registers.h"
#include "firmware/modbus/serial_line.h"
#include "firmware/types.h"

namespace finsight {

struct ModbusSettings {
  std::string address = "127.0.0.1";  ///< IPv4 address to listen on; "0.0.0.0" for all
  int port = 502;                     ///< 0: any free port
  static constexpr int kMostClients = 64;
  int max_clients = 32;
  int max_per_address = 0;                  ///< of these; 0: half of them
  std::vector<std::uint32_t> reserve = {};  ///< addresses (host byte order) for each of which one place is kept
  int idle_limit_s = 60;                    ///< a client that sends no request for so long is closed
  /// 1 to 247: that of the (first) finger, which 0 and 255 mean as well; others get no answer. 0: the fingers are 1, 2,
  /// ...; a single one answers to every unit id.
  int unit = 0;
  std::vector<Network> allow = {};         ///< who may connect; empty: everybody
  std::vector<Network> allow_writes = {};  ///< who of them may write once unlocked; empty: all
  std::optional<SerialSettings> serial = std::nullopt;

  int most_per_address() const { return max_per_address ? max_per_address : std::max(max_clients / 2, 1); }
};

/// Serves the latest RegisterImage published for each finger (before that: `first`) with the commands and settings of
/// its Control under its own unit id, and a block that gathers all fingers under every one of them. A read of several
/// registers is one consistent snapshot; register 3 (age) is computed when it is read. No client, whatever it sends or
/// leaves unread, makes the server allocate memory or delays other clients by more than the time that one of its
/// requests takes. ClientPlaces and TcpClient say what one gets.
class ModbusServer {
 public:
  /// Opens the port; throws std::system_error naming address and port (in use, not an IPv4 address, not permitted).
  /// A serial line that cannot be opened is not an error; `report` gets the reason, see SerialLine.
  /// `controls`: 1 to 4 fingers, in the order of their unit ids; they must outlive the server.
  /// `first`: what every finger serves until something is published for it.
  ModbusServer(const ModbusSettings& settings, std::span<Control* const> controls,
               const std::function<void(const std::string&)>& report = {}, const RegisterImage& first = empty_block());
  ModbusServer(const ModbusSettings& settings, Control& control,
               const std::function<void(const std::string&)>& report = {});
  ~ModbusServer();  ///< stops the threads and closes every connection
  /// Wait-free, from one thread at a time for each finger.
  void publish(const RegisterImage& image, std::size_t finger = 0) noexcept;
  int port() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace finsight
