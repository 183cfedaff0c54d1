#include "firmware/ports/hand_over.h"

#include <doctest/doctest.h>

#include <thread>

using namespace finsight;
using namespace std::chrono_literals;

TEST_CASE("hand-over: values come in their order, and a full queue takes none") {
  HandOver<int, 4> queue;
  CHECK_FALSE(queue.take());
  for (int round = 0; round < 3; ++round) {
    for (int value = 0; value < 4; ++value) CHECK(queue.put(value));
    CHECK_FALSE(queue.put(4));
    for (int value = 0; value < 4; ++value) CHECK(queue.take() == value);
    CHECK_FALSE(queue.take());
  }
}

TEST_CASE("hand-over: a wait ends with a value, when it is woken, and at its limit") {
  HandOver<int, 4> queue;
  const auto start = std::chrono::steady_clock::now();
  CHECK_FALSE(queue.wait_until(start + 30ms));
  CHECK(std::chrono::steady_clock::now() - start >= 30ms);
  std::thread writer([&] {
    std::this_thread::sleep_for(20ms);
    queue.put(7);
    std::this_thread::sleep_for(20ms);
    queue.wake();
  });
  CHECK(queue.wait_until(start + 20s));
  CHECK(queue.take() == 7);
  CHECK(queue.wait_until(start + 20s));
  CHECK_FALSE(queue.take());
  writer.join();
  CHECK(std::chrono::steady_clock::now() - start < 20s);
}

TEST_CASE("hand-over: between two threads no value is lost, doubled or torn") {
  struct Pair {
    long a, b;
  };
  HandOver<Pair, 8> queue;
  constexpr long kValues = 20'000;
  std::thread writer([&] {
    for (long value = 0; value < kValues;) {
      if (queue.put({value, -value})) {
        ++value;
      } else {
        std::this_thread::yield();
      }
    }
  });
  long next = 0;
  bool good = true;
  while (next < kValues && good) {
    good = queue.wait_until(std::chrono::steady_clock::now() + 20s);
    while (const auto pair = queue.take()) {
      good = good && pair->a == next && pair->b == -next;
      ++next;
    }
  }
  writer.join();
  CHECK(good);
  CHECK(next == kValues);
}
