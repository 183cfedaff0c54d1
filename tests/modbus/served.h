// A Modbus server to test, and a request whose response is known.
#pragma once

#include <utility>

#include "firmware/modbus/server.h"
#include "tests/modbus/raw_client.h"

namespace finsight::tests {

/// A server on a free port whose register i holds 0x1000 + i.
class Served {
 public:
  explicit Served(ModbusSettings settings = {}) : server_(on_any_port(std::move(settings)), control_) {
    RegisterImage image;
    for (std::size_t i = 0; i < image.words.size(); ++i) image.words[i] = static_cast<std::uint16_t>(0x1000 + i);
    server_.publish(image);
  }
  int port() const { return server_.port(); }
  ModbusServer& operator*() { return server_; }
  Control& control() { return control_; }

 private:
  static ModbusSettings on_any_port(ModbusSettings settings) {
    settings.port = 0;
    return settings;
  }
  Control control_;
  ModbusServer server_;
};

inline const Bytes kReadOne = hex("0001 0000 0006 01 03 0005 0001");
inline const Bytes kReadOneReply = hex("0001 0000 0005 01 03 02 1005");

/// The server answers this client.
inline bool is_answered(Connection& client) { return client.ask(kReadOne, kReadOneReply.size()) == kReadOneReply; }

/// The i-th register in the response to a read.
inline std::uint16_t word_at(const Bytes& reply, std::size_t i) {
  return static_cast<std::uint16_t>(reply[9 + 2 * i] << 8 | reply[10 + 2 * i]);
}

}  // namespace finsight::tests
