#include "firmware/modbus/write_lock.h"

#include <algorithm>
#include <utility>

namespace finsight {

Exception WriteLock::try_key(std::uint16_t key, std::uint32_t client, std::int64_t now_ns) {
  const auto failed = std::ranges::find(failed_, client, &Failed::client);
  const bool must_wait = failed != failed_.end() && now_ns < failed->wait_until_ns;
  // A client that is unlocked already learns nothing from its key being right.
  if (must_wait && !(key == key_ && is_unlocked(client, now_ns))) return Exception::kBusy;
  if (key != key_ || key == kNoWriteKey) {
    note_wrong_key(client, now_ns);
    return Exception::kIllegalValue;
  }
  if (failed != failed_.end() && !must_wait) *failed = {};
  return unlock(client, now_ns);
}

Exception WriteLock::unlock(std::uint32_t client, std::int64_t now_ns) {
  for (Unlocked& unlocked : unlocked_) {
    if (now_ns >= unlocked.until_ns) unlocked = {};
  }
  auto place = std::ranges::find(unlocked_, client, &Unlocked::client);
  if (place == unlocked_.end()) {
    const auto rank = [](const Unlocked& unlocked) { return std::pair(unlocked.has_written, unlocked.until_ns); };
    place = std::ranges::min_element(unlocked_, {}, rank);
    if (place->has_written) return Exception::kBusy;
  }
  *place = {client, now_ns + kUnlocked_ns, place->client == client && place->has_written};
  return Exception::kNone;
}

void WriteLock::note_wrong_key(std::uint32_t client, std::int64_t now_ns) {
  auto place = std::ranges::find(failed_, client, &Failed::client);
  if (place == failed_.end()) {
    place = std::ranges::min_element(failed_, {}, &Failed::wait_until_ns);
    *place = {};
  }
  if (now_ns - place->last_ns > kForgotten_ns) place->times = 0;
  const int waits = ++place->times - kFreeTries;
  const std::int64_t wait_ns = waits <= 0 ? 0 : std::min(kFirstWait_ns << std::min(waits - 1, 10), kLongestWait_ns);
  *place = {client, place->times, now_ns, now_ns + wait_ns};
}

bool WriteLock::renew(std::uint32_t client, std::int64_t now_ns) {
  const auto found = std::ranges::find(unlocked_, client, &Unlocked::client);
  if (found == unlocked_.end() || now_ns >= found->until_ns) return false;
  found->until_ns = now_ns + kUnlocked_ns;
  found->has_written = true;
  return true;
}

std::int64_t WriteLock::unlocked_until_ns(std::uint32_t client) const {
  const auto found = std::ranges::find(unlocked_, client, &Unlocked::client);
  return found == unlocked_.end() ? 0 : found->until_ns;
}

}  // namespace finsight
