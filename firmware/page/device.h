// The measuring program as the page sees it: its published block, and its registers over Modbus.
#pragma once

#include <array>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "firmware/modbus/register_client.h"
#include "firmware/modbus/register_table.h"
#include "firmware/page/request_guard.h"
#include "firmware/page/settings_change.h"
#include "firmware/published/block.h"
#include "firmware/settings/settings.h"

namespace finsight::page {

/// Status of a refusal where the measuring program does not answer at all.
inline constexpr unsigned kDoesNotAnswer = 503;

/// Thread-safe. Nothing here throws on what the other program does or does not do.
class Device {
 public:
  explicit Device(const Settings& settings);

  /// The newest frame as an event for browsers; empty if there is none that was not given out before.
  std::string new_frame_event();
  /// Commands, settings, process helpers, history and diagnostics, read over Modbus, as an event.
  std::string registers_event();

  /// Every register by name, see register_text.h.
  nlohmann::json values();
  /// {"word address": word, ...} of the settings, for the export.
  nlohmann::json settings_json();
  /// What does not change while finsightd runs; empty: it does not publish.
  std::string about();
  std::optional<PublishedFrame> frame();
  std::optional<PublishedPicture> picture();
  /// Displacements of the surface's points in 0.01 mm, and the number of their frame.
  std::optional<std::pair<std::uint64_t, std::vector<std::int16_t>>> shape();
  /// Keeps pictures and shapes coming.
  void watch();

  // What a Modbus client does. Nothing: it is done.
  std::optional<Refusal> write(int first, std::span<const std::uint16_t> words);
  /// `sequence`: the number that the command's result will have in the history.
  std::optional<Refusal> order(const std::string& command, std::uint16_t& sequence);
  /// Settings by name, in their units; all of them or none.
  std::optional<Refusal> change_settings(const nlohmann::json& wanted);
  /// By its register, now. Nothing: the device does not answer.
  std::optional<bool> is_recording();

 private:
  struct Words {
    std::array<std::uint16_t, kMeasurementRegisters> measurements{};
    std::array<std::uint16_t, kControlRegisters> control{};
    std::array<std::uint16_t, kProcessBlockRegisters> process{};
    std::array<std::uint16_t, kHistoryRegisters> history{};
    std::array<std::uint16_t, kGatheredRegisters> gathered{};
    std::array<std::uint16_t, kDiagnosticsRegisters> diagnostics{};
    std::string error = "not read yet";
    std::int64_t read_ns = 0;
  };
  BlockReader* reader();
  const Words& registers(std::int64_t not_older_ns);
  std::optional<Refusal> write_unlocked(int first, std::span<const std::uint16_t> words);

  const std::filesystem::path folder_;
  const std::uint16_t key_;

  std::mutex block_mutex_;  ///< over what follows
  std::unique_ptr<BlockReader> block_;
  std::string block_error_;
  std::int64_t looked_ns_ = 0, watched_ns_ = 0;
  std::uint64_t sent_ = 0;

  std::mutex modbus_mutex_;  ///< over what follows; held while the device answers
  RegisterClient client_;
  Words words_;
  std::int64_t unlocked_ns_ = 0;
  std::uint16_t sequence_;
};

}  // namespace finsight::page
