#include "firmware/modbus/client_places.h"

#include <doctest/doctest.h>

using namespace finsight;

namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

/// The address whose connection is closed for the newcomer; 0: none had to be, -1: the newcomer is refused.
int let_in(ClientPlaces& places, std::uint32_t address, std::int64_t now_ns, bool asks = true) {
  const auto place = places.place_for(address, now_ns);
  if (!place) return -1;
  const int replaced = places[*place].is_open ? static_cast<int>(places[*place].address) : 0;
  places[*place] = {true, address, asks, now_ns};
  return replaced;
}

}  // namespace

TEST_CASE("places: a newcomer takes the idlest connection of whoever holds at least two more") {
  ClientPlaces places(4, 4, {});
  for (int i = 0; i < 4; ++i) CHECK(let_in(places, 1, i) == 0);
  CHECK(let_in(places, 1, 5) == -1);
  CHECK(let_in(places, 2, 6) == 1);
  CHECK(places[0].address == 2);  // the idlest was the first
  CHECK(let_in(places, 2, 7) == 1);
  CHECK(let_in(places, 2, 8) == -1);  // two and two
  CHECK(let_in(places, 3, 9) == 1);
  CHECK(let_in(places, 4, 10) == 2);
  CHECK(let_in(places, 5, 11) == -1);  // one each
}

TEST_CASE("places: who is mute goes first, then who is quiet") {
  ClientPlaces places(3, 3, {});
  let_in(places, 1, 0);
  let_in(places, 1, 1);
  let_in(places, 2, 2, false);
  CHECK(let_in(places, 3, 2 * kSecond + 2) == 2);
  CHECK(let_in(places, 3, 2 * kSecond + 3) == -1);
  CHECK(let_in(places, 3, 10 * kSecond) == 1);
}

TEST_CASE("places: a place is kept for each reserved address, and it replaces its own connection if it must") {
  ClientPlaces places(4, 2, {8, 9});
  CHECK(let_in(places, 1, 0) == 0);
  CHECK(let_in(places, 2, 0) == 0);
  CHECK(let_in(places, 3, 0) == -1);
  CHECK(let_in(places, 9, 1) == 0);
  CHECK(let_in(places, 9, 2) == 9);  // the last place is that of 8
  CHECK(let_in(places, 8, 3) == 0);
  CHECK(let_in(places, 8, 4) == 8);
  CHECK(let_in(places, 3, 5) == -1);
  CHECK(let_in(places, 3, 60 * kSecond) == 1);  // the quiet ones of 8 and 9 keep their only places
  CHECK(let_in(places, 4, 60 * kSecond) == 2);
  CHECK(let_in(places, 5, 60 * kSecond) == -1);
}

TEST_CASE("places: an address at its limit gets only places of its own that are not used") {
  ClientPlaces places(8, 2, {});
  CHECK(let_in(places, 1, 0) == 0);
  CHECK(let_in(places, 1, 0) == 0);
  CHECK(let_in(places, 1, 1) == -1);
  CHECK(let_in(places, 1, 10 * kSecond) == 1);
}
