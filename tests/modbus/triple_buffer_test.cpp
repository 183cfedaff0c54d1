#include "firmware/modbus/triple_buffer.h"

#include <doctest/doctest.h>

#include <array>
#include <cstdint>
#include <thread>

using namespace finsight;

TEST_CASE("triple buffer: the reader gets the latest value, and again the same until there is a new one") {
  TripleBuffer<int> buffer(7);
  CHECK(buffer.read() == 7);
  CHECK(buffer.read() == 7);
  buffer.publish(1);
  buffer.publish(2);
  buffer.publish(3);
  CHECK(buffer.read() == 3);
  CHECK(buffer.read() == 3);
  buffer.publish(4);
  CHECK(buffer.read() == 4);
}

TEST_CASE("triple buffer: a value that is being read stays as it is while new ones are published") {
  TripleBuffer<int> buffer(0);
  buffer.publish(1);
  const int& held = buffer.read();
  for (int i = 2; i < 10; ++i) buffer.publish(i);
  CHECK(held == 1);
  CHECK(buffer.read() == 9);
}

TEST_CASE("triple buffer: across threads no value is torn or older than one read before, and the last one arrives") {
  constexpr std::uint32_t kValues = 200'000;
  using Value = std::array<std::uint32_t, 64>;
  TripleBuffer<Value> buffer(Value{});
  std::thread publisher([&] {
    Value value;
    for (std::uint32_t n = 1; n <= kValues; ++n) {
      value.fill(n);
      buffer.publish(value);
    }
  });
  int torn = 0, older = 0;
  for (std::uint32_t last = 0; last < kValues;) {
    const Value& value = buffer.read();
    const std::uint32_t first = value.front();
    for (const std::uint32_t word : value) torn += word != first;
    older += first < last;
    last = first;
  }
  publisher.join();
  CHECK(torn == 0);
  CHECK(older == 0);
}
