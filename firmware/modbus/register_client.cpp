#include "firmware/modbus/register_client.h"

#include <modbus.h>

#include <cerrno>
#include <utility>

namespace finsight {

struct RegisterClient::Connection {
  modbus_t* context;
  explicit Connection(modbus_t* opened) : context(opened) {}
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;
  ~Connection() {
    modbus_close(context);
    modbus_free(context);
  }
};

RegisterClient::RegisterClient(std::string address, int port, int unit, int timeout_ms)
    : address_(std::move(address)), port_(port), unit_(unit), timeout_ms_(timeout_ms) {}
RegisterClient::~RegisterClient() = default;

template <class Ask>
RegisterClient::Answer RegisterClient::exchange(const Ask& ask) {
  for (const bool is_last_try : {false, true}) {
    const bool is_fresh = !connection_;
    if (is_fresh) {
      auto opened = std::make_unique<Connection>(modbus_new_tcp(address_.c_str(), port_));
      if (!opened->context) return {.error = "no memory"};
      modbus_set_slave(opened->context, unit_);
      const auto seconds = static_cast<std::uint32_t>(timeout_ms_ / 1000);
      const auto microseconds = static_cast<std::uint32_t>(timeout_ms_ % 1000 * 1000);
      modbus_set_response_timeout(opened->context, seconds, microseconds);
      if (modbus_connect(opened->context) != 0) return {.error = modbus_strerror(errno)};
      connection_ = std::move(opened);
    }
    if (ask(connection_->context) >= 0) return {};
    const int error = errno;
    if (error > MODBUS_ENOBASE && error <= EMBXGTAR) {
      return {.exception = static_cast<Exception>(error - MODBUS_ENOBASE)};
    }
    connection_.reset();
    // A connection that lay idle may have been closed by the server; only a fresh one tells. One that timed out was not
    // closed, and what was asked may have been done.
    if (is_fresh || is_last_try || error == ETIMEDOUT) return {.error = modbus_strerror(error)};
  }
  return {.error = "not connected"};
}

RegisterClient::Answer RegisterClient::read(int first, std::span<std::uint16_t> words) {
  return exchange([&](modbus_t* context) {
    return modbus_read_registers(context, first, static_cast<int>(words.size()), words.data());
  });
}

RegisterClient::Answer RegisterClient::write(int first, std::span<const std::uint16_t> words) {
  return exchange([&](modbus_t* context) {
    return words.size() == 1 ? modbus_write_register(context, first, words[0])
                             : modbus_write_registers(context, first, static_cast<int>(words.size()), words.data());
  });
}

}  // namespace finsight
