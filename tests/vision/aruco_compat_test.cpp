#include "firmware/vision/aruco_compat.h"

#include <doctest/doctest.h>

#include <set>
#include <stdexcept>

using namespace finsight;

TEST_CASE("marker modules: 50 different codes in a black border") {
  std::set<std::array<std::uint8_t, 36>> codes;
  for (int id = 0; id < kDictionaryMarkers; ++id) {
    const std::array<std::uint8_t, 36> modules = marker_modules(id);
    codes.insert(modules);
    for (std::size_t i = 0; i < 36; ++i) {
      const std::size_t row = i / 6, column = i % 6;
      CHECK(modules[i] <= 1);
      if (row == 0 || row == 5 || column == 0 || column == 5) CHECK(modules[i] == 0);
    }
  }
  CHECK(codes.size() == 50);
  CHECK_THROWS_AS(marker_modules(-1), std::invalid_argument);
  CHECK_THROWS_AS(marker_modules(50), std::invalid_argument);
}
