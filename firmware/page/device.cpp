#include "firmware/page/device.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <random>

#include "firmware/modbus/registers.h"
#include "firmware/page/register_text.h"

namespace finsight::page {

namespace {

using nlohmann::json;

constexpr int kAnswerTime_ms = 1000;
constexpr std::int64_t kLookAgain_ns = kNsPerS / 2;  // for a block that is not there
constexpr std::int64_t kStale_ns = kNsPerS;          // a frame older than this says nothing about now
constexpr std::int64_t kRenewKey_ns = 20 * kNsPerS;  // an unlock lasts 30 s
constexpr std::int64_t kOldRegisters_ns = 400'000'000;

/// The address that reaches a server which listens on this one.
std::string reachable(const std::string& address) { return address == "0.0.0.0" ? "127.0.0.1" : address; }

Refusal refusal_of(const RegisterClient::Answer& answer) {
  if (!answer.error.empty())
    return {kDoesNotAnswer, "The measuring program does not answer over Modbus: " + answer.error + "."};
  switch (answer.exception) {
    case Exception::kIllegalValue:
      return {409,
              "Refused (exception 3): a value is out of its range, or an \"on\" threshold is not above its \"off\" "
              "threshold."};
    case Exception::kLocked:
      return {403, "Refused (exception 4): the page's own address is not allowed to write (modbus.allow_writes)."};
    case Exception::kBusy:
      return {409, "Refused (exception 6): a command is still running, or another client has the device to itself."};
    default:
      return {409, "Refused (exception " + std::to_string(static_cast<int>(answer.exception)) + ")."};
  }
}

json frame_json(const PublishedFrame& frame, std::int64_t now_ns) {
  RegisterImage image{.words = frame.words, .process = frame.process, .exposure_ns = frame.exposure_ns};
  set_age(image, now_ns);
  const auto rounded = [](float value) { return std::isfinite(value) ? json(std::round(value * 1e4) / 1e4) : json(); };
  json event = {{"n", frame.number},
                {"t_ms", static_cast<double>(frame.exposure_ns / 100'000) / 10},
                {"words", image.words},
                {"process", image.process},
                {"found", frame.marker_found},
                {"seen", frame.plate_seen},
                {"has_image", frame.has_image != 0},
                {"work_us", rounded(frame.work_us)}};
  for (std::size_t p = 0; p < kPlates; ++p) {
    json corners = json::array();
    for (const auto& corner : frame.corners_px[p]) corners.push_back({rounded(corner[0]), rounded(corner[1])});
    event["corners"].push_back(frame.marker_found[p] ? corners : json());
    event["reprojection_px"].push_back(rounded(frame.reprojection_px[p]));
    json plate = json::array();
    for (const float number : frame.plate[p]) plate.push_back(rounded(number));
    event["plates"].push_back(plate);
  }
  for (std::size_t s = 0; s < kPublishedStages.size(); ++s) {
    const PublishedTimes& times = frame.times[s];
    event["times"][kPublishedStages[s]] = {rounded(times.p50_us), rounded(times.p99_us), rounded(times.worst_us)};
  }
  return event;
}

}  // namespace

Device::Device(const Settings& settings)
    : folder_(settings.page->folder),
      key_(settings.write_key),
      client_(reachable(settings.modbus.address), settings.modbus.port, settings.unit, kAnswerTime_ms),
      sequence_(static_cast<std::uint16_t>(std::random_device()())) {}

/// Opens the block again where finsightd has started again. Null: there is none.
BlockReader* Device::reader() {
  const std::int64_t now_ns = steady_now_ns();
  if (now_ns - looked_ns_ < kLookAgain_ns) return block_.get();
  looked_ns_ = now_ns;
  if (block_ && block_->is_current()) return block_.get();
  block_.reset();
  sent_ = 0;
  try {
    block_ = std::make_unique<BlockReader>(folder_);
    block_error_.clear();
  } catch (const std::exception& error) {
    block_error_ = error.what();
  }
  return block_.get();
}

const Device::Words& Device::registers(std::int64_t not_older_ns) {
  if (steady_now_ns() - words_.read_ns < not_older_ns) return words_;
  const auto read = [&](int first, std::span<std::uint16_t> words) {
    const RegisterClient::Answer answer = client_.read(first, words);
    if (!answer.is_good()) words_.error = refusal_of(answer).reason;
    return answer.is_good();
  };
  const bool good = read(0, words_.measurements) && read(kControlAddress, words_.control) &&
                    read(kProcessAddress, words_.process) && read(kHistoryAddress, words_.history) &&
                    read(kGatheredAddress, words_.gathered) && read(kDiagnosticsAddress, words_.diagnostics);
  if (good) words_.error.clear();
  words_.read_ns = steady_now_ns();
  return words_;
}

std::string Device::new_frame_event() {
  const std::lock_guard guard(block_mutex_);
  BlockReader* block = reader();
  if (!block) return "";
  const auto frame = block->frame();
  const std::int64_t now_ns = steady_now_ns();
  if (!frame || frame->number == sent_ || now_ns - frame->published_ns > kStale_ns) return "";
  sent_ = frame->number;
  return frame_json(*frame, now_ns).dump();
}

std::string Device::registers_event() {
  std::string block_error;
  {
    const std::lock_guard guard(block_mutex_);
    if (!reader()) block_error = block_error_;
  }
  const std::lock_guard guard(modbus_mutex_);
  const Words& words = registers(kOldRegisters_ns);
  return json{{"error", words.error},       {"block_error", block_error},      {"measurements", words.measurements},
              {"control", words.control},   {"process", words.process},        {"history", words.history},
              {"gathered", words.gathered}, {"diagnostics", words.diagnostics}}
      .dump();
}

json Device::values() {
  json values = json::object();
  {
    const std::lock_guard guard(modbus_mutex_);
    const Words& words = registers(kOldRegisters_ns);
    if (!words.error.empty()) return {{"error", words.error}};
    constexpr std::size_t kWordOrderAt = static_cast<std::size_t>(address_of("word_order") - kControlAddress);
    const bool low_word_first = words.control[kWordOrderAt] == value_named("word_order", "CDAB");
    add_values(kRegisterTable.measurements, words.measurements, low_word_first, values);
    add_values(kRegisterTable.control, words.control, low_word_first, values);
    add_values(kRegisterTable.process, words.process, low_word_first, values);
    add_values(kRegisterTable.history, words.history, low_word_first, values);
    add_values(kRegisterTable.gathered, words.gathered, low_word_first, values);
    add_values(kRegisterTable.diagnostics, words.diagnostics, low_word_first, values);
  }
  return values;
}

json Device::settings_json() {
  json settings = json::object();
  const json all = values();
  for (int i = 0; i < kSettingCount; ++i) {
    const RegisterRow& row = setting_row(i);
    if (row.writable && all.contains(row.name)) settings[row.name] = all[row.name];
  }
  return settings;
}

std::string Device::about() {
  const std::lock_guard guard(block_mutex_);
  looked_ns_ = 0;  // an export must be of the finsightd that runs now, not of the one before its restart
  const BlockReader* block = reader();
  return block ? block->contents().about : "";
}

std::optional<PublishedFrame> Device::frame() {
  const std::lock_guard guard(block_mutex_);
  BlockReader* block = reader();
  return block ? block->frame() : std::nullopt;
}

std::optional<PublishedPicture> Device::picture() {
  const std::lock_guard guard(block_mutex_);
  BlockReader* block = reader();
  PublishedPicture picture;
  if (!block || !block->picture(picture)) return std::nullopt;
  return picture;
}

std::optional<std::pair<std::uint64_t, std::vector<std::int16_t>>> Device::shape() {
  const std::lock_guard guard(block_mutex_);
  BlockReader* block = reader();
  std::vector<std::int16_t> shape;
  const auto frame = block ? block->frame(&shape) : std::nullopt;
  if (!frame || shape.empty()) return std::nullopt;
  return std::pair(frame->number, std::move(shape));
}

void Device::watch() {
  const std::lock_guard guard(block_mutex_);
  const std::int64_t now_ns = steady_now_ns();
  if (now_ns - watched_ns_ < kNsPerS / 2) return;
  watched_ns_ = now_ns;
  try {
    watch_block(folder_);
  } catch (const std::exception& error) {
    block_error_ = error.what();
  }
}

std::optional<Refusal> Device::write_unlocked(int first, std::span<const std::uint16_t> words) {
  const std::int64_t now_ns = steady_now_ns();
  RegisterClient::Answer answer;
  for (const bool must_unlock : {now_ns - unlocked_ns_ > kRenewKey_ns, true}) {
    if (must_unlock) {
      answer = client_.write(kKeyRegister, std::array{key_});
      if (!answer.is_good()) return refusal_of(answer);
    }
    answer = client_.write(first, words);
    if (answer.is_good()) {
      unlocked_ns_ = now_ns;
      words_.read_ns = 0;  // what was read before is old now
      return std::nullopt;
    }
    if (answer.exception != Exception::kLocked) break;  // only that may be because the device was started again
  }
  return refusal_of(answer);
}

std::optional<Refusal> Device::write(int first, std::span<const std::uint16_t> words) {
  const std::lock_guard guard(modbus_mutex_);
  return write_unlocked(first, words);
}

std::optional<Refusal> Device::order(const std::string& command, std::uint16_t& sequence) {
  const auto& commands = row_named("command").values;
  const auto found = std::ranges::find(commands, command, &NamedValue::name);
  if (found == commands.end()) return Refusal{400, "There is no command \"" + command + "\"."};
  const std::lock_guard guard(modbus_mutex_);
  sequence_ = sequence_ == 0xFFFF ? 1 : static_cast<std::uint16_t>(sequence_ + 1);
  sequence = sequence_;
  return write_unlocked(kCommandRegister, std::array{found->value, sequence});
}

std::optional<bool> Device::is_recording() {
  const std::lock_guard guard(modbus_mutex_);
  std::array<std::uint16_t, 1> state{};
  if (!client_.read(kRecordingRegister, state).is_good()) return std::nullopt;
  return state[0] == value_named("recording", "recording");
}

std::optional<Refusal> Device::change_settings(const json& wanted) {
  const std::lock_guard guard(modbus_mutex_);
  const Words& words = registers(0);
  if (!words.error.empty()) return Refusal{503, words.error};
  SettingsWords settings(words.control, words.process);
  if (auto refusal = apply_settings(wanted, settings)) return refusal;
  if (settings.changes_control) {
    if (auto refusal = write_unlocked(kFirstSettingRegister, settings.control)) return refusal;
  }
  return settings.changes_process ? write_unlocked(kProcessAddress, settings.process) : std::nullopt;
}

}  // namespace finsight::page
