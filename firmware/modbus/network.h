// IPv4 addresses and networks, and lists of clients made of them.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace finsight {

/// A network such as "192.168.0.0/24", or a single address.
struct Network {
  std::uint32_t address = 0, mask = 0;                           ///< host byte order
  static std::optional<Network> parse(const std::string& text);  ///< nothing if `text` is neither
  bool is_address() const { return mask == 0xFFFF'FFFFU; }
  bool contains(std::uint32_t client) const { return (client & mask) == (address & mask); }
};

/// Whether `text` is an address in dotted decimal, with a prefix length ("/24", at least 1) if `with_prefix`, else
/// without.
bool is_ipv4(const std::string& text, bool with_prefix);

/// Whether a device can have this address in this network: neither reserved (0.0.0.0/8, loopback, multicast and above)
/// nor the network's first or last, which are the network itself and all of its devices.
bool is_host(const Network& network);

/// Whether the client is on the list; everybody is on an empty list.
bool is_listed(const std::vector<Network>& list, std::uint32_t client);

}  // namespace finsight
