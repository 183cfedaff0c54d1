// Which requests are answered at all: those that a page of this device has sent from an address that may, not those
// that some other page makes a browser send.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/modbus/write_lock.h"
#include "firmware/settings/settings.h"

namespace finsight::page {

/// What a browser asks. Header fields that are absent are empty.
struct Request {
  std::string method = {}, path = {}, host = {}, origin = {}, fetch_site = {}, fetch_mode = {}, token = {},
              content_type = {}, body = {};
  std::uint32_t client = 0;  ///< IPv4, host byte order
};

/// Why a request is refused: an HTTP status, and a sentence for people.
struct Refusal {
  unsigned status = 403;
  std::string reason;
};

/// Whether `host` (a Host header, with or without port) names this device: an IPv4 address, localhost, a .local name,
/// or one of `names`. A name that belongs to somebody else may point here only to read what it must not (DNS
/// rebinding); an address cannot.
bool is_own_host(std::string_view host, const std::vector<std::string>& names);

/// Nothing if this request may be looked at: what a page makes a browser send must come from a page of the host that it
/// is sent to. Only links may lead here from elsewhere.
std::optional<Refusal> check_request(const Request& request, const PageSettings& settings);

/// Who has given the key. Thread-safe.
class Sessions {
 public:
  Sessions(std::uint16_t key, const PageSettings& settings) : settings_(settings), lock_(key) {}

  static constexpr std::size_t kMost = 16;  ///< browsers at once; the next one replaces the oldest
  struct Unlock {
    std::string token;  ///< empty: refused
    Refusal refusal;
  };
  /// A token for the right key. Wrong keys cost their address time, as over Modbus.
  Unlock unlock(std::uint16_t key, std::uint32_t client, std::int64_t now_ns);
  /// Nothing if the request bears a token that was given to its address and was used within 30 s; it is then good for
  /// another 30 s.
  std::optional<Refusal> check_token(const Request& request, std::int64_t now_ns);
  void end(const std::string& token);

 private:
  struct Session {
    std::string token;
    std::uint32_t client = 0;
    std::int64_t until_ns = 0;
  };
  const PageSettings& settings_;
  std::mutex mutex_;
  WriteLock lock_;
  std::array<Session, kMost> sessions_;
};

}  // namespace finsight::page
