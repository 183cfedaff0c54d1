// Who gets one of the server's places: shared fairly between addresses, with one kept for each address that is
// reserved.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace finsight {

/// A place for one connection.
struct ClientPlace {
  bool is_open = false;
  std::uint32_t address = 0;   ///< of its client
  bool has_asked = false;      ///< it has sent a whole request
  std::int64_t active_ns = 0;  ///< time of its connection or last request
};

class ClientPlaces {
 public:
  /// A connection that has sent no request for so long may be replaced: before its first request, and after.
  static constexpr std::int64_t kMute_ns = 2'000'000'000, kQuiet_ns = 10'000'000'000;

  /// An address holds at most `most_per_address` places. One place of `count` is kept for each address in `reserved`;
  /// there must be fewer of those than places.
  ClientPlaces(std::size_t count, std::size_t most_per_address, std::vector<std::uint32_t> reserved);

  /// The place that a newcomer from this address gets, closing whoever has it; nothing if it is refused. It gets
  /// 1. a free place, unless that is kept for another address;
  /// 2. else that of a connection that is mute or quiet (section 4.2.1.1 of Modbus Messaging on TCP/IP V1.0b: the
  /// oldest
  ///    unused connection is closed), but not the only one of a reserved address;
  /// 3. else the idlest of the addresses that hold most, if these hold at least two more than it;
  /// 4. else, if its address is reserved, that of its own idlest connection: after a cable pull it is dead.
  /// An address that has as many as it may hold gets only 2 and 4, and among its own.
  std::optional<std::size_t> place_for(std::uint32_t address, std::int64_t now_ns) const;

  ClientPlace& operator[](std::size_t place) { return places_[place]; }
  const ClientPlace& operator[](std::size_t place) const { return places_[place]; }
  std::size_t size() const { return places_.size(); }
  std::size_t held_by(std::uint32_t address) const;
  std::size_t open() const;

 private:
  std::size_t kept_from(std::uint32_t address) const;
  bool is_reserved(std::uint32_t address) const;
  bool is_unused(const ClientPlace& place, std::int64_t now_ns) const;
  std::size_t most_held() const;
  template <class Accept>
  std::optional<std::size_t> idlest(const Accept& accept) const;

  std::vector<ClientPlace> places_;
  std::size_t most_per_address_;
  std::vector<std::uint32_t> reserved_;
};

}  // namespace finsight
