#include "firmware/modbus/client_places.h"

#include <algorithm>
#include <cassert>
#include <tuple>
#include <utility>

namespace finsight {

ClientPlaces::ClientPlaces(std::size_t count, std::size_t most_per_address, std::vector<std::uint32_t> reserved)
    : places_(count), most_per_address_(most_per_address), reserved_(std::move(reserved)) {
  assert(reserved_.size() < count);
}

std::size_t ClientPlaces::held_by(std::uint32_t address) const {
  return static_cast<std::size_t>(
      std::ranges::count_if(places_, [&](const ClientPlace& p) { return p.is_open && p.address == address; }));
}

std::size_t ClientPlaces::open() const {
  return static_cast<std::size_t>(std::ranges::count_if(places_, &ClientPlace::is_open));
}

bool ClientPlaces::is_reserved(std::uint32_t address) const {
  return std::ranges::find(reserved_, address) != reserved_.end();
}

/// How many free places wait for reserved addresses other than this one.
std::size_t ClientPlaces::kept_from(std::uint32_t address) const {
  return static_cast<std::size_t>(
      std::ranges::count_if(reserved_, [&](std::uint32_t r) { return r != address && held_by(r) == 0; }));
}

bool ClientPlaces::is_unused(const ClientPlace& place, std::int64_t now_ns) const {
  const std::int64_t quiet_ns = now_ns - place.active_ns;
  return quiet_ns >= (place.has_asked ? kQuiet_ns : kMute_ns);
}

/// Of the open places that `accept` accepts, one that never sent a request, or else the one quiet for longest.
template <class Accept>
std::optional<std::size_t> ClientPlaces::idlest(const Accept& accept) const {
  const auto rank = [](const ClientPlace& p) { return std::tuple(p.has_asked, p.active_ns); };
  std::optional<std::size_t> found;
  for (std::size_t i = 0; i < places_.size(); ++i) {
    if (!places_[i].is_open || !accept(places_[i])) continue;
    if (!found || rank(places_[i]) < rank(places_[*found])) found = i;
  }
  return found;
}

std::size_t ClientPlaces::most_held() const {
  std::size_t most = 0;
  for (const ClientPlace& place : places_) {
    if (place.is_open) most = std::max(most, held_by(place.address));
  }
  return most;
}

std::optional<std::size_t> ClientPlaces::place_for(std::uint32_t address, std::int64_t now_ns) const {
  const std::size_t own = held_by(address);
  const bool has_all_it_may = own >= most_per_address_;
  if (!has_all_it_may && places_.size() - open() > kept_from(address)) {
    const auto free = std::ranges::find(places_, false, &ClientPlace::is_open);
    return static_cast<std::size_t>(free - places_.begin());
  }
  const auto unused = idlest([&](const ClientPlace& p) {
    if (!is_unused(p, now_ns)) return false;
    if (p.address == address) return true;
    return !has_all_it_may && !(is_reserved(p.address) && held_by(p.address) == 1);
  });
  if (unused) return unused;
  if (const std::size_t most = most_held(); !has_all_it_may && most >= own + 2) {
    return idlest([&](const ClientPlace& p) { return held_by(p.address) == most; });
  }
  if (!is_reserved(address)) return std::nullopt;
  return idlest([&](const ClientPlace& p) { return p.address == address; });
}

}  // namespace finsight
