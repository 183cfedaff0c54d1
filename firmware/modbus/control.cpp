#include "firmware/modbus/control.h"

#include <algorithm>
#include <array>
#include <limits>

namespace finsight {

namespace {

bool is_in(int block, int registers, int first, int count) {
  return first >= block && first + count <= block + registers;
}

bool is_in_control(int first, int count) {
  return is_in(kControlAddress, kControlRegisters, first, count) ||
         is_in(kProcessAddress, kProcessBlockRegisters, first, count);
}

/// Writable registers that mean something of their own are written alone; command and number only together.
bool may_be_written(int first, std::size_t count) {
  if (!is_in_control(first, static_cast<int>(count))) return false;
  const auto* row = &control_row(first);
  if (!std::all_of(row, row + count, [](const RegisterRow& r) { return r.writable; })) return false;
  if (first == kCommandRegister) return count == 2;
  if (first == kGravityRegister) return count == kGravityRegisters;
  if (first > kGravityRegister || (first >= kProcessAddress && first + static_cast<int>(count) > kGravityRegister)) {
    return false;
  }
  return first >= kFirstSettingRegister || (first != kSequenceRegister && count == 1);
}

}  // namespace

bool Control::has_registers(int first, int count) {
  return is_in_control(first, count) || is_in(kHistoryAddress, kHistoryRegisters, first, count) ||
         is_in(kDiagnosticsAddress, kDiagnosticsRegisters, first, count);
}

void Control::read(int first, std::span<std::uint16_t> words, const ClientAccess& access, std::int64_t now_ns,
                   std::int64_t stalled_since_ns) {
  const std::lock_guard lock(mutex_);
  settle();
  const auto copy = [&](const auto& block, int address) {
    std::copy_n(block.begin() + (first - address), words.size(), words.begin());
  };
  if (first >= kDiagnosticsAddress) {
    std::array<std::uint16_t, kDiagnosticsRegisters> block;
    LoopHealth health = health_.read();
    if (stalled_since_ns != 0) health.mark_stalled(stalled_since_ns);
    write_diagnostics(counts_, health, identity_, processor_temperature_degc_, started_ns_, now_ns,
                      has_low_word_first(settings_), block);
    copy(block, kDiagnosticsAddress);
  } else if (first >= kHistoryAddress) {
    std::array<std::uint16_t, kHistoryRegisters> block;
    read_history(block, access, now_ns);
    copy(block, kHistoryAddress);
  } else {
    for (std::size_t i = 0; i < words.size(); ++i) words[i] = word(first + static_cast<int>(i), access, now_ns);
  }
}

void Control::read_history(std::span<std::uint16_t, kHistoryRegisters> words, const ClientAccess& access,
                           std::int64_t now_ns) const {
  history_.write_registers(words, access, exclusive_client(now_ns), has_low_word_first(settings_));
}

std::uint16_t Control::word(int address, const ClientAccess& access, std::int64_t now_ns) const {
  switch (address) {
    case kCommandRegister:
      return history_.last_given().command;
    case kSequenceRegister:
      return history_.last_given().sequence;
    case kResultSequenceRegister:
      return history_.last_finished().sequence;
    case kResultRegister:
      return history_.last_finished().result;
    case kKeyRegister: {
      const std::int64_t left_ns = std::max<std::int64_t>(lock_.unlocked_until_ns(access.address) - now_ns, 0);
      return static_cast<std::uint16_t>((left_ns + kNsPerS - 1) / kNsPerS);
    }
    case kRecordingRegister:
      return recording_;
    case kRefreshRegister:
      return refresh_;
    case kExclusiveRegister:
      return exclusive_client(now_ns) != kNobody;
    case kGravityRegister:
    case kGravityRegister + 1:
    case kGravityRegister + 2:
      return static_cast<std::uint16_t>(packed_gravity_ >> (16 * (address - kGravityRegister)));
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

std::uint32_t Control::exclusive_client(std::int64_t now_ns) const {
  return lock_.is_unlocked(exclusive_client_, now_ns) ? exclusive_client_ : kNobody;
}

/// Takes over the result that the frame loop has left.
void Control::settle() {
  if (history_.is_running() && !busy_) history_.finish(result_);
}

Exception Control::write(int first, std::span<const std::uint16_t> words, const ClientAccess& access,
                         std::int64_t now_ns) {
  if (!may_be_written(first, words.size())) return Exception::kIllegalAddress;
  if (!access.may_write) return Exception::kLocked;
  const std::lock_guard lock(mutex_);
  settle();
  exclusive_client_ = exclusive_client(now_ns);  // who lets the unlock end gives the place up for good
  if (first == kKeyRegister) return write_key(words[0], access, now_ns);
  if (!lock_.renew(access.address, now_ns)) return Exception::kLocked;
  if (first == kRefreshRegister) {  // also beside an exclusive writer: the master must not seem lost because of one
    refresh_ = words[0];
    refreshed_ns_ = now_ns;
    return Exception::kNone;
  }
  if (exclusive_client_ != kNobody && exclusive_client_ != access.address) return Exception::kBusy;
  if (first == kExclusiveRegister) return write_exclusive(words[0], access);
  if (first == kCommandRegister) return write_command(words[0], words[1], access, now_ns);
  if (first == kGravityRegister) {
    write_gravity(words, now_ns);
    return Exception::kNone;
  }
  return write_settings(first, words);
}

Exception Control::write_key(std::uint16_t key, const ClientAccess& access, std::int64_t now_ns) {
  const Exception answer = lock_.try_key(key, access.address, now_ns);
  if (answer == Exception::kIllegalValue) {
    ++counts_.wrong_keys;
    counts_.wrong_key_client = access.address;
  }
  return answer;
}

Exception Control::write_exclusive(std::uint16_t on, const ClientAccess& access) {
  if (on > control_row(kExclusiveRegister).highest) return Exception::kIllegalValue;
  exclusive_client_ = on ? access.address : kNobody;
  return Exception::kNone;
}

Exception Control::write_command(std::uint16_t command, std::uint16_t sequence, const ClientAccess& access,
                                 std::int64_t now_ns) {
  if (command > control_row(kCommandRegister).highest || sequence == 0) return Exception::kIllegalValue;
  const CommandHistory::Number number = history_.judge(sequence, command, access, now_ns);
  // A client that has lost the answer repeats its request, which must not start the command a second time.
  if (number == CommandHistory::Number::kRepeated) return Exception::kNone;
  if (number == CommandHistory::Number::kUsed) return Exception::kIllegalValue;
  if (history_.is_running()) return Exception::kBusy;
  if (static_cast<Command>(command) == Command::kFactory) to_loop_.publish(settings_ = factory_);
  history_.begin(sequence, command, access, now_ns);
  busy_ = true;
  pending_ = command;
  return Exception::kNone;
}

void Control::write_gravity(std::span<const std::uint16_t> words, std::int64_t now_ns) {
  std::uint64_t packed = 0;
  for (std::size_t i = 0; i < words.size(); ++i) packed |= std::uint64_t{words[i]} << (16 * i);
  packed_gravity_ = packed;
  gravity_ns_ = now_ns;
}

std::optional<Vec3f> Control::felt_gravity(std::int64_t now_ns) const {
  const std::int64_t written_ns = gravity_ns_;
  if (written_ns == 0 || gravity_max_age_ns_ == 0 || now_ns - written_ns > gravity_max_age_ns_) return std::nullopt;
  const std::uint64_t packed = packed_gravity_;
  Vec3f felt_g;
  for (int i = 0; i < kGravityRegisters; ++i) {
    felt_g[i] = static_cast<float>(control_row(kGravityRegister).scale) *
                static_cast<float>(static_cast<std::int16_t>(packed >> (16 * i)));
  }
  return felt_g;
}

// The new settings are a copy that takes effect only after it has been checked as a whole.
Exception Control::write_settings(int first, std::span<const std::uint16_t> words) {
  RuntimeSettings settings = settings_;
  std::ranges::copy(words, settings.words.begin() + setting_at(first));
  if (settings == settings_) return Exception::kNone;
  if (history_.is_running()) return Exception::kBusy;
  if (!are_valid(settings)) return Exception::kIllegalValue;
  to_loop_.publish(settings_ = settings);
  return Exception::kNone;
}

RuntimeSettings Control::settings_copy() {
  const std::lock_guard lock(mutex_);
  return settings_;
}

GivenCommand Control::last_finished() {
  const std::lock_guard lock(mutex_);
  settle();
  return history_.last_finished();
}

void Control::remember(GivenCommand given) {
  constexpr std::uint64_t kClosed = std::numeric_limits<std::uint64_t>::max();
  given.connection = kClosed;
  const std::lock_guard lock(mutex_);
  history_.remember(given);
}

void Control::count_answer(Exception answer) {
  const std::lock_guard lock(mutex_);
  ++counts_.requests;
  if (answer != Exception::kNone) ++counts_.exceptions[static_cast<std::size_t>(answer)];
}

void Control::count_connection(Arrival arrival) {
  const std::lock_guard lock(mutex_);
  counts_.refused += arrival == Arrival::kRefused;
  counts_.accepted += arrival != Arrival::kRefused;
  counts_.replaced += arrival == Arrival::kReplacing;
}

void Control::show_open_connections(std::uint32_t open) {
  const std::lock_guard lock(mutex_);
  counts_.open = open;
}

void Control::identify(const DeviceIdentity& identity) {
  const std::lock_guard lock(mutex_);
  identity_ = identity;
}

std::optional<Command> Control::take_command() {
  const std::uint32_t pending = pending_.exchange(kNoCommand);
  return pending == kNoCommand ? std::nullopt : std::optional(static_cast<Command>(pending));
}

void Control::finish(CommandResult result) {
  result_ = static_cast<std::uint16_t>(result);
  busy_ = false;
}

bool Control::is_master_lost(std::int64_t now_ns) {
  const std::int64_t timeout_ns = kNsPerMs * settings()[kMasterTimeout];
  if (timeout_ns == 0) {
    guarded_since_ns_ = 0;
    return false;
  }
  if (guarded_since_ns_ == 0) guarded_since_ns_ = now_ns;
  return now_ns - std::max<std::int64_t>(refreshed_ns_, guarded_since_ns_) > timeout_ns;
}

std::int64_t Control::stalled_since_ns(const RegisterImage& image, std::int64_t now_ns) const {
  if (image.exposure_ns == 0) return 0;  // nothing was measured yet
  const std::int64_t made_ns = image.words[0] & kCameraFault ? published_ns_.load() : image.exposure_ns;
  return now_ns - made_ns > stale_after_ns_ ? made_ns + stale_after_ns_ : 0;
}

}  // namespace finsight
