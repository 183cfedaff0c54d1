#include "firmware/ports/hand_over.h"

#include <doctest/doctest.h>

#include <thread>
#include <vector>

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

TEST_CASE("hand-over: between two threads no value is lost or doubled, and what was written before it can be read") {
  HandOver<int, 8> queue;
  constexpr int kValues = 20'000;
  std::vector<int> written(kValues);
  std::thread writer([&] {
    for (int value = 0; value < kValues; ++value) {
      written[static_cast<std::size_t>(value)] = -value;
      while (!queue.put(value)) std::this_thread::yield();
    }
  });
  int next = 0;
  bool good = true;
  while (next < kValues && good) {
    // Half of them without waiting, so that nothing but the queue itself orders the two threads.
    if (next > kValues / 2) good = queue.wait_until(std::chrono::steady_clock::now() + 20s);
    while (const auto value = queue.take()) {
      good = good && *value == next && written[static_cast<std::size_t>(next)] == -next;
      ++next;
    }
  }
  writer.join();
  CHECK(good);
  CHECK(next == kValues);
}
