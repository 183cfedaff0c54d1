// A Modbus TCP client: reads and writes the registers of this or another device as a PLC would.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "firmware/modbus/exception.h"

namespace finsight {

/// Not thread-safe. Connects by itself, also again after the connection was lost.
class RegisterClient {
 public:
  /// IPv4 address. No answer within `timeout_ms` counts as a lost connection.
  RegisterClient(std::string address, int port, int unit, int timeout_ms);
  ~RegisterClient();
  RegisterClient(const RegisterClient&) = delete;
  RegisterClient& operator=(const RegisterClient&) = delete;

  struct Answer {
    Exception exception = Exception::kNone;  ///< what the device answered with
    std::string error = {};                  ///< why there was no answer; empty: there was one
    bool is_good() const { return error.empty() && exception == Exception::kNone; }
  };
  /// At most 125 registers.
  Answer read(int first, std::span<std::uint16_t> words);
  /// At most 123 registers, by function 6 (one) or 16.
  Answer write(int first, std::span<const std::uint16_t> words);

 private:
  struct Connection;
  template <class Ask>
  Answer exchange(const Ask& ask);
  const std::string address_;
  const int port_, unit_, timeout_ms_;
  std::unique_ptr<Connection> connection_;
};

}  // namespace finsight
