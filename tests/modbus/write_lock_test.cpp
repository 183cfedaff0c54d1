#include "firmware/modbus/write_lock.h"

#include <doctest/doctest.h>

using namespace finsight;

namespace {

constexpr std::int64_t kSecond = 1'000'000'000;
constexpr std::uint16_t kKey = 4711;
constexpr std::uint32_t kPlc = 1, kAttacker = 2;

}  // namespace

TEST_CASE("write lock: a wrong key takes nothing away from a client of the same address that is unlocked") {
  WriteLock lock(kKey);
  CHECK(lock.try_key(kKey, kPlc, 0) == Exception::kNone);
  CHECK(lock.try_key(1, kPlc, 1) == Exception::kIllegalValue);
  CHECK(lock.renew(kPlc, 2));
}

TEST_CASE("write lock: while its address must wait, a client that is unlocked stays so with the right key") {
  WriteLock lock(kKey);
  CHECK(lock.try_key(kKey, kPlc, 0) == Exception::kNone);
  for (int i = 0; i < 5; ++i) lock.try_key(1, kPlc, kSecond);
  CHECK(lock.try_key(1, kPlc, kSecond) == Exception::kBusy);
  CHECK(lock.try_key(kKey, kPlc, kSecond) == Exception::kNone);
  CHECK(lock.is_unlocked(kPlc, 30 * kSecond));
  CHECK(lock.try_key(1, kPlc, kSecond + 1) == Exception::kBusy);  // the wait goes on
}

TEST_CASE("write lock: after two wrong keys the wait doubles from 1 to 64 s, and no key is looked at meanwhile") {
  WriteLock lock(kKey);
  std::int64_t now_ns = 0;
  for (const int wait_s : {0, 0, 1, 2, 4, 8, 16, 32, 64, 64}) {
    CAPTURE(wait_s);
    CHECK(lock.try_key(1, kAttacker, now_ns) == Exception::kIllegalValue);
    if (wait_s == 0) continue;
    CHECK(lock.try_key(kKey, kAttacker, now_ns + wait_s * kSecond - 1) == Exception::kBusy);
    CHECK_FALSE(lock.renew(kAttacker, now_ns + wait_s * kSecond - 1));
    now_ns += wait_s * kSecond;
  }
  CHECK(lock.try_key(kKey, kAttacker, now_ns) == Exception::kNone);
  CHECK(lock.try_key(1, kAttacker, now_ns) == Exception::kIllegalValue);  // the right key has ended the count
  CHECK(lock.try_key(kKey, kAttacker, now_ns) == Exception::kNone);
}

TEST_CASE("write lock: in an hour one address can try fewer than a hundred keys, and shuts nobody else out") {
  WriteLock lock(kKey);
  int tried = 0;
  for (std::int64_t now_ns = 0; now_ns < 3600 * kSecond; now_ns += kSecond / 10) {
    tried += lock.try_key(1, kAttacker, now_ns) == Exception::kIllegalValue;
    REQUIRE(lock.try_key(kKey, kPlc, now_ns) == Exception::kNone);
  }
  CHECK(tried > 50);
  CHECK(tried < 100);
}

TEST_CASE("write lock: attackers at a thousand addresses do not shut out a rightful client at its own") {
  WriteLock lock(kKey);
  CHECK(lock.try_key(kKey, kPlc, 0) == Exception::kNone);
  for (std::uint32_t n = 0; n < 4000; ++n) lock.try_key(1, 10 + n % 1000, n);
  CHECK(lock.renew(kPlc, kSecond));
  CHECK(lock.try_key(kKey, 3, kSecond) == Exception::kNone);
}

TEST_CASE("write lock: wrong keys are forgotten after ten minutes without one") {
  WriteLock lock(kKey);
  for (int i = 0; i < 3; ++i) lock.try_key(1, kPlc, 0);
  CHECK(lock.try_key(kKey, kPlc, kSecond / 2) == Exception::kBusy);
  CHECK(lock.try_key(1, kPlc, 601 * kSecond) == Exception::kIllegalValue);
  CHECK(lock.try_key(kKey, kPlc, 601 * kSecond) == Exception::kNone);
}

TEST_CASE("write lock: seventeen others with the right key do not end the unlock of a client that writes") {
  WriteLock lock(kKey);
  CHECK(lock.try_key(kKey, kPlc, 0) == Exception::kNone);
  REQUIRE(lock.renew(kPlc, 1));
  const auto others_unlock = [&lock](std::int64_t now_ns) {
    for (std::uint32_t other = 10; other < 10 + 17; ++other)
      CHECK(lock.try_key(kKey, other, now_ns) == Exception::kNone);
  };
  others_unlock(kSecond);
  CHECK(lock.is_unlocked(kPlc, kSecond));
  CHECK(lock.try_key(kKey, kPlc, 2 * kSecond) == Exception::kNone);  // to unlock again does not make it idle
  others_unlock(3 * kSecond);
  CHECK(lock.is_unlocked(kPlc, 3 * kSecond));
}

TEST_CASE("write lock: while sixteen clients write, another's right key is answered as busy, until one of them stops") {
  WriteLock lock(kKey);
  for (std::uint32_t writer = 10; writer < 10 + WriteLock::kRememberedUnlocks; ++writer) {
    REQUIRE(lock.try_key(kKey, writer, 0) == Exception::kNone);
    REQUIRE(lock.renew(writer, 0));
  }
  CHECK(lock.try_key(kKey, kPlc, 1) == Exception::kBusy);
  CHECK(lock.try_key(kKey, 10, 1) == Exception::kNone);
  CHECK(lock.try_key(kKey, kPlc, 30 * kSecond) == Exception::kNone);
  CHECK(lock.is_unlocked(10, 30 * kSecond));
}

TEST_CASE("write lock: a device that has no key is unlocked by none") {
  WriteLock lock(kNoWriteKey);
  CHECK(lock.try_key(0, kPlc, 0) == Exception::kIllegalValue);
  CHECK(lock.try_key(kDefaultWriteKey, kPlc, kSecond) == Exception::kIllegalValue);
  CHECK_FALSE(lock.is_unlocked(kPlc, kSecond));
}
