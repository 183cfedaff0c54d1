#include "firmware/modbus/network.h"

#include <arpa/inet.h>

#include <algorithm>
#include <charconv>

namespace finsight {

std::optional<Network> Network::parse(const std::string& text) {
  if (text.find('\0') != std::string::npos) return std::nullopt;  // inet_pton would ignore what follows
  const std::size_t slash = text.find('/');
  int prefix = 32;
  if (slash != std::string::npos) {
    const char* end = text.data() + text.size();
    const auto [rest, error] = std::from_chars(text.data() + slash + 1, end, prefix);
    if (error != std::errc() || rest != end || prefix < 0 || prefix > 32) return std::nullopt;
  }
  in_addr address{};
  if (inet_pton(AF_INET, text.substr(0, slash).c_str(), &address) != 1) return std::nullopt;
  const std::uint32_t mask = prefix == 0 ? 0 : 0xFFFF'FFFFU << (32 - prefix);
  return Network{ntohl(address.s_addr), mask};
}

bool is_ipv4(const std::string& text, bool with_prefix) {
  const std::optional<Network> network = Network::parse(text);
  return network && (text.find('/') != std::string::npos) == with_prefix && network->mask != 0;
}

bool is_host(const Network& network) {
  const std::uint32_t first_byte = network.address >> 24;
  if (first_byte == 0 || first_byte == 127 || first_byte >= 224) return false;
  const std::uint32_t rest = network.address & ~network.mask;
  return ~network.mask <= 1 || (rest != 0 && rest != ~network.mask);  // a network of two has no such addresses
}

bool is_listed(const std::vector<Network>& list, std::uint32_t client) {
  return list.empty() || std::ranges::any_of(list, [&](const Network& n) { return n.contains(client); });
}

}  // namespace finsight
