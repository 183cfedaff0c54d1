// Which clients: IPv4 addresses and networks.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace finsight {

/// "192.168.0.0/24", or one address.
struct Network {
  std::uint32_t address = 0, mask = 0;  ///< host byte order
  static std::optional<Network> parse(const std::string& text);
  bool contains(std::uint32_t client) const { return (client & mask) == (address & mask); }
};

/// Dotted decimal, with a prefix length ("/24", at least 1) or without.
bool is_ipv4(const std::string& text, bool with_prefix);

/// An empty list is everybody.
bool is_listed(const std::vector<Network>& list, std::uint32_t client);

}  // namespace finsight
