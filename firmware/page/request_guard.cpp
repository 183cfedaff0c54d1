#include "firmware/page/request_guard.h"

#include <sys/random.h>

#include <algorithm>
#include <cctype>

namespace finsight::page {

namespace {

/// 128 random bits in hexadecimal; empty if the kernel gives none.
std::string random_token() {
  std::array<unsigned char, 16> bytes{};
  if (getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) return "";
  std::string token;
  for (const unsigned char byte : bytes) {
    constexpr const char* kDigits = "0123456789abcdef";
    token += kDigits[byte >> 4];
    token += kDigits[byte & 15];
  }
  return token;
}

/// Takes the same time wherever the two differ.
bool is_same(const std::string& a, const std::string& b) {
  if (a.size() != b.size()) return false;
  unsigned difference = 0;
  for (std::size_t i = 0; i < a.size(); ++i) difference |= static_cast<unsigned char>(a[i] ^ b[i]);
  return difference == 0;
}

std::string lower(std::string_view text) {
  std::string small(text);
  std::ranges::transform(small, small.begin(), [](unsigned char c) { return std::tolower(c); });
  return small;
}

}  // namespace

bool is_own_host(std::string_view host, const std::vector<std::string>& names) {
  const std::size_t colon = host.find(':');
  const std::string name = lower(host.substr(0, colon));
  if (colon != std::string_view::npos) {
    const std::string_view port = host.substr(colon + 1);
    if (port.empty() || port.size() > 5 || !std::ranges::all_of(port, [](char c) { return c >= '0' && c <= '9'; })) {
      return false;
    }
  }
  if (name.empty() || name.size() > 253) return false;
  if (is_ipv4(name, false) || name == "localhost") return true;
  const auto is_plain = [](char c) { return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-'; };
  constexpr std::string_view kLocal = ".local";
  if (name.size() > kLocal.size() && name.ends_with(kLocal) &&
      std::ranges::all_of(name.substr(0, name.size() - kLocal.size()), is_plain)) {
    return true;
  }
  return std::ranges::any_of(names, [&](const std::string& known) { return lower(known) == name; });
}

std::optional<Refusal> check_request(const Request& request, const PageSettings& settings) {
  if (!is_own_host(request.host, settings.names)) {
    return Refusal{421,
                   "The name in the address bar is not one of this device's. Use its address, its .local name, or a "
                   "name from page.names in the board file."};
  }
  const bool only_looks = request.method == "GET" || request.method == "HEAD";
  if (!only_looks && request.method != "POST") return Refusal{405, "Only GET, HEAD and POST are answered."};
  if (!request.origin.empty() && request.origin != "http://" + request.host &&
      request.origin != "https://" + request.host) {
    return Refusal{403, "This request was made by a page of another site."};
  }
  const bool is_link = only_looks && request.fetch_mode == "navigate";
  if (!is_link && !request.fetch_site.empty() && request.fetch_site != "same-origin" && request.fetch_site != "none") {
    return Refusal{403, "This request was made by a page of another site."};
  }
  return std::nullopt;
}

Sessions::Unlock Sessions::unlock(std::uint16_t key, std::uint32_t client, std::int64_t now_ns) {
  if (!is_listed(settings_.allow_writes, client)) {
    return {"", {403, "Your computer's address is not one of those that may change things (page.allow_writes)."}};
  }
  const std::lock_guard guard(mutex_);
  switch (lock_.try_key(key, client, now_ns)) {
    case Exception::kNone:
      break;
    case Exception::kBusy:
      return {"", {429, "Too many wrong keys came from your address. Wait a minute, then try again."}};
    default:
      return {"", {403, "That is not the key of this device (write_key in the board file)."}};
  }
  Session& place = *std::ranges::min_element(sessions_, {}, &Session::until_ns);
  place = {random_token(), client, now_ns + kUnlocked_ns};
  if (place.token.empty()) return {"", {503, "The device has no random numbers yet. Try again."}};
  return {place.token, {}};
}

std::optional<Refusal> Sessions::check_token(const Request& request, std::int64_t now_ns) {
  if (request.token.empty()) return Refusal{401, "Locked: enter the device's key first."};
  const std::lock_guard guard(mutex_);
  for (Session& session : sessions_) {
    if (session.token.empty() || !is_same(session.token, request.token) || session.client != request.client) continue;
    if (now_ns >= session.until_ns) break;
    session.until_ns = now_ns + kUnlocked_ns;
    return std::nullopt;
  }
  return Refusal{401, "Locked again, because nothing was changed for 30 s: enter the device's key."};
}

void Sessions::end(const std::string& token) {
  const std::lock_guard guard(mutex_);
  for (Session& session : sessions_) {
    if (!session.token.empty() && is_same(session.token, token)) session = {};
  }
}

}  // namespace finsight::page
