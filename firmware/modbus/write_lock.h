// Which clients may write: those that have written the device's key and keep writing. A wrong key costs its address
// time and nobody else anything.
#pragma once

#include <array>
#include <cstdint>

#include "firmware/modbus/exception.h"
#include "firmware/types.h"

namespace finsight {

inline constexpr std::uint16_t kDefaultWriteKey = 18003;  // "FS"
inline constexpr std::uint16_t kNoWriteKey = 0;           ///< no key is right: nobody can write
inline constexpr std::int64_t kUnlocked_ns = 30'000'000'000;

/// Not thread-safe: under Control's mutex. Times are of the steady clock; clients are addresses (ClientAccess).
class WriteLock {
 public:
  /// When full, the next replaces, of those that have not written since they unlocked, the one that ends first. A
  /// client that writes, as an exclusive writer has, is never replaced.
  static constexpr int kRememberedUnlocks = 16;
  /// Addresses with wrong keys; when full, the next replaces the one whose wait ends first.
  static constexpr int kRememberedFailures = 64;
  static constexpr int kFreeTries = 2;  ///< wrong keys without a wait behind them
  static constexpr std::int64_t kFirstWait_ns = kNsPerS, kLongestWait_ns = 64 * kNsPerS;
  static constexpr std::int64_t kForgotten_ns = 600'000'000'000;  ///< an address without wrong keys for so long is new

  explicit WriteLock(std::uint16_t key) : key_(key) {}

  /// kNone: unlocked. kIllegalValue: the wrong key; an unlock of this address goes on. kBusy: this address must still
  /// wait, and the key was not looked at; the right one of a client that is unlocked is taken even then. Or the key is
  /// right, and as many others as are remembered are writing.
  Exception try_key(std::uint16_t key, std::uint32_t client, std::int64_t now_ns);
  /// Whether the client is unlocked; if so, it is for another 30 s.
  bool renew(std::uint32_t client, std::int64_t now_ns);
  std::int64_t unlocked_until_ns(std::uint32_t client) const;  ///< 0: never
  bool is_unlocked(std::uint32_t client, std::int64_t now_ns) const { return now_ns < unlocked_until_ns(client); }

 private:
  struct Unlocked {
    std::uint32_t client = 0;
    std::int64_t until_ns = 0;
    bool has_written = false;  ///< since it unlocked
  };
  struct Failed {
    std::uint32_t client = 0;
    int times = 0;
    std::int64_t last_ns = 0, wait_until_ns = 0;
  };
  Exception unlock(std::uint32_t client, std::int64_t now_ns);
  void note_wrong_key(std::uint32_t client, std::int64_t now_ns);

  const std::uint16_t key_;
  std::array<Unlocked, kRememberedUnlocks> unlocked_;
  std::array<Failed, kRememberedFailures> failed_;
};

}  // namespace finsight
