#include "firmware/modbus/control.h"

#include <algorithm>

namespace finsight {

namespace {

bool is_writable(int first, std::size_t count) {
  const auto* row = &control_row(first);
  return std::all_of(row, row + count, [](const RegisterRow& r) { return r.writable; });
}

}  // namespace

void Control::read(int first, std::span<std::uint16_t> words, const ClientAccess& access, std::int64_t now_ns) {
  const std::lock_guard lock(mutex_);
  for (std::size_t i = 0; i < words.size(); ++i) words[i] = word(first + static_cast<int>(i), access, now_ns);
}

std::uint16_t Control::word(int address, const ClientAccess& access, std::int64_t now_ns) const {
  const std::uint32_t result = result_;
  constexpr std::int64_t kSecond_ns = 1'000'000'000;
  switch (address) {
    case kCommandRegister:
      return command_;
    case kSequenceRegister:
      return sequence_;
    case kResultSequenceRegister:
      return static_cast<std::uint16_t>(result >> 16);
    case kResultRegister:
      return static_cast<std::uint16_t>(result);
    case kKeyRegister: {
      const std::int64_t left_ns = std::max<std::int64_t>(unlocked_until_ns(access.address) - now_ns, 0);
      return static_cast<std::uint16_t>((left_ns + kSecond_ns - 1) / kSecond_ns);
    }
    case kRecordingRegister:
      return recording_;
    case address_of("recording_s"):
      return recording_s_;
    case address_of("recording_mb_left"):
      return recording_mb_left_;
    default: {
      const int setting = setting_at(address);
      return setting < 0 ? 0 : settings_.words[static_cast<std::size_t>(setting)];
    }
  }
}

std::int64_t Control::unlocked_until_ns(std::uint32_t client) const {
  const auto found = std::ranges::find(unlocked_, client, &Unlocked::client);
  return found == unlocked_.end() ? 0 : found->until_ns;
}

Exception Control::write_key(std::uint16_t key, std::uint32_t client, std::int64_t now_ns) {
  auto place = std::ranges::find(unlocked_, client, &Unlocked::client);
  if (place == unlocked_.end()) place = std::ranges::min_element(unlocked_, {}, &Unlocked::until_ns);
  *place = {client, key == key_ ? now_ns + kUnlocked_ns : 0};
  return key == key_ ? Exception::kNone : Exception::kIllegalValue;
}

// The new state is a copy that takes effect only after it has been checked as a whole.
Exception Control::write(int first, std::span<const std::uint16_t> words, const ClientAccess& access,
                         std::int64_t now_ns) {
  if (!is_writable(first, words.size())) return Exception::kIllegalAddress;
  if (!access.may_write) return Exception::kIllegalFunction;
  const std::lock_guard lock(mutex_);
  if (first == kKeyRegister) return write_key(words[0], access.address, now_ns);
  if (now_ns >= unlocked_until_ns(access.address)) return Exception::kIllegalFunction;
  RuntimeSettings settings = settings_;
  std::uint16_t command = command_, sequence = sequence_;
  for (std::size_t i = 0; i < words.size(); ++i) {
    const int address = first + static_cast<int>(i);
    std::uint16_t& target = address == kCommandRegister ? command
                            : address == kSequenceRegister
                                ? sequence
                                : settings.words[static_cast<std::size_t>(setting_at(address))];
    target = words[i];
  }
  // A client that has lost the answer repeats its request, which must not start the command a second time.
  if (settings == settings_ && command == command_ && sequence == sequence_) return Exception::kNone;
  if (busy_) return Exception::kBusy;
  if (command > control_row(kCommandRegister).highest || !are_valid(settings)) return Exception::kIllegalValue;

  command_ = command;
  sequence_ = sequence;
  const bool starts = sequence != static_cast<std::uint16_t>(result_ >> 16);
  if (starts && static_cast<Command>(command) == Command::kFactory) settings = factory_;
  if (settings != settings_) to_loop_.publish(settings_ = settings);
  if (starts) {
    running_sequence_ = sequence;
    busy_ = true;
    pending_ = command;
  }
  return Exception::kNone;
}

std::optional<Command> Control::take_command() {
  const std::uint32_t pending = pending_.exchange(kNoCommand);
  return pending == kNoCommand ? std::nullopt : std::optional(static_cast<Command>(pending));
}

void Control::finish(CommandResult result) {
  result_ = static_cast<std::uint32_t>(running_sequence_) << 16 | static_cast<std::uint32_t>(result);
  busy_ = false;
}

}  // namespace finsight
